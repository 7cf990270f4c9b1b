"""Identification while the robot moves."""
