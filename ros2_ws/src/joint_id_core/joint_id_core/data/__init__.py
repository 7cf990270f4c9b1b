"""Recordings: measured signals over time, with their names and units."""
