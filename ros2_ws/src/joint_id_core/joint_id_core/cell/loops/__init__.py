"""Loops over time around a cell. They are templates that `cell.kernel` compiles for each model."""
