"""What `speed.py` measures of the engine, one part a file, and how it measures."""
