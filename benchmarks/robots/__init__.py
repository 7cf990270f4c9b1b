"""Fits of public recordings of real robots: what is fitted, how it is judged, and the tables."""
