"""What the online engine does when its assumptions break; `benchmarks/online.py` runs it."""
