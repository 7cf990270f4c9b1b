"""Simulation of a joint model by adaptive Dormand-Prince 4(5) with exact stick and slip."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from joint_id_core.arguments import require_type
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.models.curved_inputs import curved
from joint_id_core.simulation.dormand_prince import Derivative, State, Step, step
from joint_id_core.simulation.stick_slip import StickSlip

_FIRST_STEP = 1e-6  # s; the step may grow fivefold each time
_SHORTEST_STEP = 1e-15  # s
_MEAN_STEP = 1e-6  # s; a model that needs shorter steps on average has implausible parameters
_GRACE_STEPS = 1000  # steps before the mean step is checked
_EVENTS = 200  # most changes of mode within one millisecond
_ABSOLUTE = 1e-3  # absolute tolerance over rtol and the scale of a state: 1e-10 rad at the link by default


class JointSimulator:
    """Simulation of a joint that advances step by step, for example once per period of a control loop.

    Step size and stick-slip modes are kept from call to call. `time` is in s from the start.

    Args:
        model: any joint model.
        values: changes to its nominal parameters.
        x0: start state by channel name; states not named are zero (default: at rest).
        rtol: relative tolerance of a step; the absolute one is 1e-3 rtol times the scale of the state.

    Raises:
        JointIdError: unknown parameter or state, a value out of bounds, a start state that is not finite.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float] | None = None,
        x0: Mapping[str, float] | None = None,
        rtol: float = 1e-7,
    ) -> None:
        if not 1e-13 <= rtol <= 1e-2:
            raise JointIdError(f"rtol = {rtol}: must be in [1e-13, 1e-2]")
        self.model = model
        self.time = 0.0
        self._rtol = rtol
        self._atol = [_ABSOLUTE * rtol * s.scale for s in model.states]
        # A model may build these tuples again at every access.
        self._state_names, self._input_names = model.state_names, model.input_names
        self._optional, self._rates = model.optional_inputs, model.rates
        self._x = _ordered(model, "state", self._state_names, x0 or {}, frozenset(self._state_names))
        self._friction = self._with(values)
        self._h = _FIRST_STEP
        self._slope: State | None = None
        self._u: list[float] | None = None
        self._events = 0
        self._events_since = 0.0

    @property
    def state(self) -> dict[str, float]:
        """Present state by channel name, SI units."""
        return dict(zip(self._state_names, self._x, strict=True))

    @property
    def modes(self) -> dict[str, int]:
        """Mode by velocity with friction: +1 or -1 while it slides, 0 while it sticks (or has no Coulomb friction)."""
        return dict(self._friction.modes)

    def change(self, values: Mapping[str, float] | None = None) -> None:
        """Go on from the present state and time with other parameters: `values` replace the nominal ones.

        Raises:
            JointIdError: unknown parameter, a value out of bounds.
        """
        self._friction = self._with(values)
        self._h, self._slope, self._u = _FIRST_STEP, None, None

    def _with(self, values: Mapping[str, float] | None) -> StickSlip:
        """Return the model with parameters after a check."""
        checked = self.model.values(values)
        try:
            return StickSlip(self.model, SimpleNamespace(**checked))
        except ZeroDivisionError as error:
            zeros = ", ".join(name for name, value in checked.items() if value == 0.0)
            raise JointIdError(
                f"model {self.model.name} divides by zero: inertia and inductance must not be 0 (zero now: {zeros})"
            ) from error

    def advance(self, dt: float, u: Mapping[str, float], end: Mapping[str, float] | None = None) -> None:
        """Advance by `dt` in s under the inputs `u`, by channel name; optional inputs that are not given are zero.

        Inputs are constant; those with hold "first" change to their value in `end` as `Model.rates` says.

        Raises:
            JointIdError: unknown or missing input, a value that is not finite, a solution that is not
                finite or that needs far too short steps.
        """
        if not (math.isfinite(dt) and dt > 0.0):
            raise JointIdError(f"cannot advance by {dt} s: the time step must be positive")
        u_0 = _ordered(self.model, "input", self._input_names, u, self._optional)
        u_1 = u_0
        if end:
            for s in self.model.inputs:
                if s.name in end and s.hold == "zero":
                    raise JointIdError(f"input {s.name} is held between samples: it has no end value")
            merged = {**dict(zip(self._input_names, u_0, strict=True)), **end}
            u_1 = _ordered(self.model, "input", self._input_names, merged, frozenset())
        self._run(dt, u_0, u_1)

    def _run(
        self, dt: float, u_0: list[float], u_1: list[float], samples: Sequence[float] = ()
    ) -> list[State]:  # fmt: skip
        """Integrate over `dt`; return the states at `samples`, increasing times in (0, dt)."""
        out: list[State] = []
        constant = u_0 == u_1
        changes = [b - a for a, b in zip(u_0, u_1, strict=True)]
        bends = [0.0 if rate is None else 0.5 * dt * changes[rate] for rate in self._rates]

        def inputs(t: float) -> Sequence[float]:
            if constant:
                return u_0
            s = t / dt
            return [a + s * (c - (1.0 - s) * b) for a, c, b in zip(u_0, changes, bends, strict=True)]

        friction, t, steps, begun = self._friction, 0.0, 0, self.time

        def derivative(t: float, x: State) -> State:
            return friction.derivative(x, inputs(t))

        try:
            if u_0 != self._u:
                friction.decide(self._x, u_0)
                self._slope = None
            while t < dt:
                if self._slope is None:
                    self._slope = derivative(t, self._x)
                if constant and not any(self._slope):
                    # In equilibrium under constant inputs nothing changes: no integration and no events.
                    out += [list(self._x) for _ in samples[len(out) :]]
                    self.time = begun + dt
                    break
                taken = self._attempt(derivative, t, self._slope, dt)
                steps += 1
                if steps > _GRACE_STEPS and t < steps * _MEAN_STEP:
                    what = f"too stiff, {steps} steps for {t:.3g} s"
                    raise JointIdError(self._where(what, "check the smallest parameters"))
                if taken is None:
                    continue
                event = friction.event(taken, inputs) if friction.suspects(taken) else None
                theta, x = event or (1.0, taken.y_1)
                last = event is None and taken.h >= dt - t
                t_1 = dt if last else t + theta * taken.h
                if len(out) < len(samples) and samples[len(out)] <= t_1:
                    state = taken.interpolant()
                    while len(out) < len(samples) and samples[len(out)] <= t_1:
                        out.append(state(min((samples[len(out)] - t) / taken.h, theta)))
                t, self._x, self._slope = t_1, x, taken.slope
                self.time = begun + t
                if event is not None:
                    self._count_event()
                    friction.decide(x, inputs(t))
                    self._slope = None
        except (OverflowError, ValueError, ZeroDivisionError) as error:
            if isinstance(error, JointIdError):
                raise
            raise JointIdError(self._where("not finite", "check units, inputs and parameters")) from error
        self._u = u_1
        return out

    def _attempt(self, f: Derivative, t: float, slope: State, dt: float) -> Step | None:
        """Try one step; if its error is too large, reduce the step size and return None."""
        left = dt - t
        cut = self._h * 1.000001 >= left
        h = left if cut else self._h
        taken = step(f, t, self._x, slope, h)
        total = 0.0
        for e, a, b, atol in zip(taken.error, taken.y_0, taken.y_1, self._atol, strict=True):
            ratio = e / (atol + self._rtol * max(abs(a), abs(b)))
            total += ratio * ratio
        norm = math.sqrt(total / len(taken.error))  # NaN if any of the values is NaN
        factor = min(5.0, max(0.2, 0.9 * norm**-0.2)) if norm > 0.0 else 5.0
        if norm <= 1.0:
            # A step that was cut by the end of the interval does not reduce the next one.
            self._h = max(self._h, h * factor) if cut else h * factor
            return taken
        self._h = h * (factor if math.isfinite(norm) else 0.2)
        if self._h < _SHORTEST_STEP:
            finite = all(map(math.isfinite, taken.y_1))
            what = "step size underflow" if finite else "not finite"
            raise JointIdError(self._where(what, "check units, inputs and parameters"))
        return None

    def _count_event(self) -> None:
        """Count a change of mode; raise JointIdError if the joint switches between stick and slip without end."""
        if self.time > self._events_since + 1e-3:
            self._events, self._events_since = 0, self.time
        self._events += 1
        if self._events > _EVENTS:
            what = f"more than {_EVENTS} changes between stick and slip in 1 ms"
            raise JointIdError(self._where(what, "check the friction parameters"))

    def _where(self, what: str, cure: str) -> str:
        state = ", ".join(f"{n} {v:.6g}" for n, v in self.state.items())
        return f"simulation of {self.model.name} at {self.time:.9g} s: {what} ({state}): {cure}"


def simulate(
    model: Model,
    time: Array,
    inputs: Mapping[str, Array],
    values: Mapping[str, float] | None = None,
    x0: Mapping[str, float] | None = None,
    rtol: float = 1e-7,
) -> Recording:
    """Simulate a joint and record its states and inputs, without noise, at the instants `time`.

    `time` in s and every input have shape (T,), T >= 2; steps may differ. Between two samples an input with hold "zero"
    keeps its value, and an input with hold "first" changes as `Model.rates` and `models.curved_inputs` say.

    Raises:
        JointIdError: see `JointSimulator`; also a missing or unknown input, a wrong shape, values that are not
            finite, fewer than two instants, what is no model.
    """
    require_type("model", model, Model, 'make it with build("rigid_joint")')
    known = Recording(time, {}, source=f"simulation of {model.name}")
    if len(known) < 2:
        raise JointIdError(f"simulation of {model.name}: time must hold at least two instants")
    given = _input_table(model, known.time, inputs)
    u = curved(model, known.time, given)
    simulator = JointSimulator(model, values, x0, rtol)
    states = [list(simulator.state.values())]
    first = np.array([s.hold == "first" for s in model.inputs])
    instants, rows = known.time.tolist(), u.tolist()
    # Samples over which the inputs are constant form one interval: the dense output gives the states within it.
    changes = np.diff(u, axis=0) != 0.0
    edges = {0, len(rows) - 1}
    edges.update((np.flatnonzero(changes.any(axis=1)) + 1).tolist())
    edges.update(np.flatnonzero(changes[:, first].any(axis=1)).tolist())
    for a, b in itertools.pairwise(sorted(edges)):
        begun, end = instants[a], np.where(first, u[b], u[a]).tolist()
        states += simulator._run(instants[b] - begun, rows[a], end, [t - begun for t in instants[a + 1 : b]])
        states.append(list(simulator.state.values()))
    columns = np.array(states).T
    channels = dict(zip((*model.state_names, *model.input_names), (*columns, *given.T), strict=True))
    return Recording(known.time, channels, source=known.source)


def _input_table(model: Model, time: Array, inputs: Mapping[str, Array]) -> Array:
    """Return the inputs as an array (T, inputs), with zeros for optional inputs that are not given."""
    _ordered(model, "input", model.input_names, dict.fromkeys(inputs, 0.0), model.optional_inputs)
    table = np.zeros((len(time), len(model.inputs)))
    for j, name in enumerate(model.input_names):
        if name not in inputs:
            continue
        values = np.asarray(inputs[name], dtype=float)
        if values.shape != time.shape:
            raise JointIdError(f"input {name} has shape {values.shape}, time has {time.shape}")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise JointIdError(f"input {name} is {values[bad[0]]} at {time[bad[0]]:.9g} s: every sample must be finite")
        table[:, j] = values
    return table


def _ordered(
    model: Model, kind: str, names: Sequence[str], given: Mapping[str, float], optional: frozenset[str]
) -> list[float]:
    """Return the values in the order of `names`, zero for those that are optional and not given."""
    for name, value in given.items():
        if name not in names:
            raise JointIdError(f"model {model.name} has no {kind} {name!r}: it has {', '.join(names)}")
        if not math.isfinite(value):
            raise JointIdError(f"{kind} {name} = {value}: must be finite")
    for name in names:
        if name not in given and name not in optional:
            raise JointIdError(f"model {model.name} needs {kind} {name!r}: it was not given")
    return [float(given.get(name, 0.0)) for name in names]
