"""One step of the Dormand-Prince 4(5) pair (ode45, RK45) on plain floats, and its dense output.

Coefficients: Dormand and Prince 1980; dense output of order 4: Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, section II.6. With at most five states, lists of floats are several times faster than arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

State = list[float]
Derivative = Callable[[float, State], State]


class Step(NamedTuple):
    """A step from `t` to `t + h`: states, derivatives at both ends, the error and all seven stages."""

    t: float
    h: float
    y_0: State
    y_1: State
    error: State
    stages: tuple[State, ...]

    @property
    def slope(self) -> State:
        """Derivative at the end, the first stage of the next step."""
        return self.stages[6]

    def interpolant(self) -> Callable[[float], State]:
        """Return a function that gives the state at `t + theta h` for theta in [0, 1], a polynomial of degree 4."""
        h = self.h
        coefficients = []
        for y_0, y_1, k_1, _, k_3, k_4, k_5, k_6, k_7 in zip(self.y_0, self.y_1, *self.stages, strict=True):
            rise = y_1 - y_0
            start = h * k_1 - rise
            quartic = h * (
                -12715105075 / 11282082432 * k_1
                + 87487479700 / 32700410799 * k_3
                - 10690763975 / 1880347072 * k_4
                + 701980252875 / 199316789632 * k_5
                - 1453857185 / 822651844 * k_6
                + 69997945 / 29380423 * k_7
            )
            coefficients.append((y_0, rise, start, rise - h * k_7 - start, quartic))

        def state(theta: float) -> State:
            rest = 1.0 - theta
            return [a + theta * (b + rest * (c + theta * (d + rest * e))) for a, b, c, d, e in coefficients]

        return state


def step(f: Derivative, t: float, y: State, k_1: State, h: float) -> Step:
    """Take one step of length `h` in s from state `y` at time `t`, with `k_1 = f(t, y)`.

    `error` is the difference between the solutions of order 4 and 5; the solution of order 5 is kept.
    """
    y_2 = [a + h * 0.2 * b for a, b in zip(y, k_1, strict=True)]
    k_2 = f(t + h * 0.2, y_2)
    y_3 = [a + h * (0.075 * b + 0.225 * c) for a, b, c in zip(y, k_1, k_2, strict=True)]
    k_3 = f(t + h * 0.3, y_3)
    y_4 = [
        a + h * (44 / 45 * b - 56 / 15 * c + 32 / 9 * d)
        for a, b, c, d in zip(y, k_1, k_2, k_3, strict=True)
    ]  # fmt: skip
    k_4 = f(t + h * 0.8, y_4)
    y_5 = [
        a + h * (19372 / 6561 * b - 25360 / 2187 * c + 64448 / 6561 * d - 212 / 729 * e)
        for a, b, c, d, e in zip(y, k_1, k_2, k_3, k_4, strict=True)
    ]
    k_5 = f(t + h * (8 / 9), y_5)
    y_6 = [
        a + h * (9017 / 3168 * b - 355 / 33 * c + 46732 / 5247 * d + 49 / 176 * e - 5103 / 18656 * g)
        for a, b, c, d, e, g in zip(y, k_1, k_2, k_3, k_4, k_5, strict=True)
    ]
    k_6 = f(t + h, y_6)
    y_7 = [
        a + h * (35 / 384 * b + 500 / 1113 * d + 125 / 192 * e - 2187 / 6784 * g + 11 / 84 * i)
        for a, b, d, e, g, i in zip(y, k_1, k_3, k_4, k_5, k_6, strict=True)
    ]
    k_7 = f(t + h, y_7)
    error = [
        h * (71 / 57600 * b - 71 / 16695 * d + 71 / 1920 * e - 17253 / 339200 * g + 22 / 525 * i - 1 / 40 * j)
        for b, d, e, g, i, j in zip(k_1, k_3, k_4, k_5, k_6, k_7, strict=True)
    ]
    return Step(t, h, y, y_7, error, (k_1, k_2, k_3, k_4, k_5, k_6, k_7))
