"""Coulomb friction as a switching system: every friction element slides forwards, slides backwards, or sticks.

While an element sticks, its velocity is exactly zero. While it slides, friction is a smooth function of the state. A
change of mode is an event; it is located on the dense output of a step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from types import SimpleNamespace

from joint_id_core.models import Model
from joint_id_core.models.operations import SmoothOps
from joint_id_core.simulation.dormand_prince import State, Step

Inputs = Callable[[float], Sequence[float]]
_EVENT_TIME = 1e-12  # s, accuracy with which an event is located


class ModeOps(SmoothOps):
    """Operations (`models.Ops`) whose direction of sliding is the mode of the element: +1, -1, or 0 while it sticks."""

    def __init__(self) -> None:
        self.modes: dict[str, int] = {}
        self.smooth: frozenset[str] = frozenset()  # velocities whose friction vanishes at rest

    def direction(self, velocity: str, w: float, w_s: float) -> float:  # type: ignore[override]  # needs the instance
        """Return the mode of the element on the state `velocity`; the sign of `w` if its friction vanishes at rest."""
        return (w > 0.0) - (w < 0.0) if velocity in self.smooth else self.modes[velocity]


class StickSlip:
    """A model with the modes of its friction elements; `derivative` is smooth until a mode changes.

    The mass matrix of every model is diagonal. So friction on one velocity does not change the other accelerations, and
    the mode of each element can be decided separately.
    """

    def __init__(self, model: Model, values: SimpleNamespace) -> None:
        self._model, self._p, self._ops = model, values, ModeOps()
        self.modes = self._ops.modes
        self._index = {v: model.state_names.index(v) for v in model.friction_states}
        self.modes.update(dict.fromkeys(self._index, 0))
        rest, none = [0.0] * len(model.states), [0.0] * len(model.inputs)
        # Without Coulomb friction there is no switching: such a velocity never sticks.
        self._elements = {
            v: i
            for v, i in self._index.items()
            if self._acceleration(v, 1, rest, none) != self._acceleration(v, -1, rest, none)
        }
        self._ops.smooth = frozenset(self._index.keys() - self._elements.keys())
        self._stuck: tuple[int, ...] = ()

    def derivative(self, x: State, u: Sequence[float]) -> State:
        """Return the time derivative in the present modes; it is zero for a velocity that sticks."""
        dx = list(self._model.derivative(x, u, self._p, self._ops))
        for i in self._stuck:
            dx[i] = 0.0
        return dx

    def _acceleration(self, velocity: str, mode: int, x: State, u: Sequence[float]) -> float:
        """Return the acceleration of an element as if it slid in direction `mode`."""
        held = self.modes[velocity]
        self.modes[velocity] = mode
        value: float = self._model.derivative(x, u, self._p, self._ops)[self._index[velocity]]
        self.modes[velocity] = held
        return value

    def _leaves(self, velocity: str, x: State, u: Sequence[float]) -> int:
        """Return the next mode of an element at rest; it slides only if the load exceeds the full static friction."""
        if self._acceleration(velocity, 1, x, u) > 0.0:
            return 1
        return -1 if self._acceleration(velocity, -1, x, u) < 0.0 else 0

    def decide(self, x: State, u: Sequence[float]) -> bool:
        """Set the mode of every element from the state; return whether a mode changed."""
        before = dict(self.modes)
        for velocity, i in self._elements.items():
            w = x[i]
            self.modes[velocity] = (w > 0.0) - (w < 0.0) if w else self._leaves(velocity, x, u)
        self._stuck = tuple(i for v, i in self._elements.items() if not self.modes[v])
        return self.modes != before

    def event(self, step: Step, inputs: Inputs) -> tuple[float, State] | None:
        """Return the first change of mode within a step: its fraction of the step, and the state there.

        A velocity that reached zero is exactly zero in that state. Returns None if no mode changes.
        """
        state = step.interpolant()
        found: list[tuple[float, str]] = []
        for velocity, i in self._elements.items():
            mode = self.modes[velocity]
            sliding = mode != 0
            theta = self._crossing(step, state, i, mode) if sliding else self._breakaway(step, state, velocity, inputs)
            if theta is not None:
                found.append((theta, velocity))
        if not found:
            return None
        theta = min(found)[0]
        x = state(theta)
        for velocity, i in self._elements.items():
            mode = self.modes[velocity]
            if mode * x[i] < 0.0 or (theta, velocity) in found:
                x[i] = 0.0
        return theta, x

    def suspects(self, step: Step) -> bool:
        """Return whether a step may contain an event: a quick test, so that most steps need no search."""
        for velocity, i in self._elements.items():
            mode = self.modes[velocity]
            if not mode:
                return True  # breakaway depends on the whole state: always search
            if mode * step.y_1[i] <= 0.0 or mode * step.stages[0][i] < 0.0 < mode * step.slope[i]:
                return True
        return False

    def _crossing(self, step: Step, state: Callable[[float], State], i: int, mode: int) -> float | None:
        """Return the fraction of the step at which a sliding element first reaches zero velocity; None if never."""

        def gone(theta: float) -> bool:
            return mode * state(theta)[i] <= 0.0

        high = 1.0
        if mode * step.y_1[i] > 0.0:
            if not mode * step.stages[0][i] < 0.0 < mode * step.slope[i]:
                return None
            # It slows down and speeds up again: it may have reached zero in between.
            high = _peak(lambda theta: -mode * state(theta)[i], 0.0, 1.0)
            if not gone(high):
                return None
        low = 0.0
        if step.y_0[i] == 0.0:
            # It broke away and stopped again within the step: start the search where it moves.
            low = 0.5 * high
            while gone(low) and low > 1e-15:
                low, high = 0.5 * low, low
        return _bisect(gone, low, high, step.h)

    def _breakaway(self, step: Step, state: Callable[[float], State], velocity: str, inputs: Inputs) -> float | None:
        """Return the fraction of the step at which a sticking element first breaks away; None if never."""

        def gone(theta: float) -> bool:
            return self._leaves(velocity, state(theta), inputs(step.t + theta * step.h)) != 0

        nodes = [0.0, 0.25, 0.5, 0.75, 1.0]
        for mode in (1, -1):

            def push(theta: float, mode: int = mode) -> float:
                return mode * self._acceleration(velocity, mode, state(theta), inputs(step.t + theta * step.h))

            values = [push(theta) for theta in nodes]
            top = values.index(max(values))
            if 0 < top < 4 and values[top] <= 0.0:
                # It comes close to breakaway at a node: check the maximum between the neighbouring nodes, too.
                nodes[top] = _peak(push, nodes[top - 1], nodes[top + 1])
        for low, theta in itertools.pairwise(nodes):
            if gone(theta):
                return _bisect(gone, low, theta, step.h)
        return None


def _peak(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the position of the maximum of a function with one maximum in [low, high], by golden-section search."""
    while high - low > 1e-6:
        left, right = low + (high - low) * 0.382, low + (high - low) * 0.618
        if f(left) > f(right):
            high = right
        else:
            low = left
    return 0.5 * (low + high)


def _bisect(gone: Callable[[float], bool], low: float, high: float, h: float) -> float:
    """Return the first fraction of the step at which `gone` holds, accurate to `_EVENT_TIME`; it holds at `high`."""
    while (high - low) * h > _EVENT_TIME:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if gone(middle):
            high = middle
        else:
            low = middle
    return high
