"""Inverse-dynamics regression: linear least squares on the equations of motion."""
