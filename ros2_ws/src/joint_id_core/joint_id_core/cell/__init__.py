"""Compile a model to one integration step (cell): Runge-Kutta 4, or implicit for stiff joints."""

CELLS = ("rk4", "implicit")
