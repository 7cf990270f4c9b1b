"""What `stats.py` measures, one part a file: cases, draws of them, other methods, tables."""
