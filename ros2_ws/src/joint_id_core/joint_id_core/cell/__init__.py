"""A model becomes one compiled integration step: Runge-Kutta 4, or implicit for stiff joints."""

CELLS = ("rk4", "implicit")
