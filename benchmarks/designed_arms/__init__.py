"""Motions designed for simulated arms: their promise beside what fits find, and other motions of the same time."""
