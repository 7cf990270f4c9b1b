"""Many fits at once: from many starts, of many draws, of many records."""
