"""Motions that show what is asked: trajectories, limits, and what a motion will tell before anything moves."""
