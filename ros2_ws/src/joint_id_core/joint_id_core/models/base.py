"""Base class of all joint models: states, inputs, parameters and one `derivative`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar, Protocol

from joint_id_core.data.signals import Parameter, Signal, derivative_of
from joint_id_core.errors import JointIdError, close_to


class Ops(Protocol):
    """The functions that a derivative may call. So the same code works with floats, torch tensors and SymPy."""

    def sin(self, x: Any) -> Any: ...
    def cos(self, x: Any) -> Any: ...
    def exp(self, x: Any) -> Any: ...
    def asinh(self, x: Any) -> Any: ...

    def direction(self, velocity: str, w: Any, w_s: Any) -> Any:
        """Return the direction of sliding, in [-1, 1], of the state called `velocity` whose value is `w`.

        Estimators use tanh(w / w_s), the paper's network sign(w), and the simulator the mode (+1, -1) of its
        stick-slip logic.
        """


@dataclass(frozen=True)
class Model:
    """A joint model. Subclasses are frozen dataclasses whose fields are the options of the model.

    Raises:
        JointIdError: an option that is True or False is something else, or a choice that there is not.
    """

    name: ClassVar[str]
    summary: ClassVar[str]

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            if isinstance(option.default, bool) and not isinstance(value, bool):
                raise JointIdError(f"model {self.name}: {option.name} = {value!r}: give True or False")
        _ = self.inputs, self.parameters  # which look at the choices: their errors come here, and not at the first use

    @property
    def states(self) -> tuple[Signal, ...]:
        """States x in the order of `derivative`."""
        raise NotImplementedError

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """Inputs u in the order of `derivative`."""
        raise NotImplementedError

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameter table, the only source of names, units, bounds and start values."""
        raise NotImplementedError

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        """Return the time derivative of the states, in SI units.

        `x` and `u` hold scalars in the order of `states` and `inputs`; `p` has one attribute per parameter.
        """
        raise NotImplementedError

    @property
    def label_delays(self) -> dict[str, tuple[str, ...]]:
        """By state, the parameters whose sum is the delay of its sensor in s; other sensors have no delay."""
        return {}

    @cached_property
    def drive(self) -> str | None:
        """The input that drives the joint: torque, current or voltage; None if the model has none of them."""
        return next((name for name in ("torque", "current", "voltage") if name in self.input_names), None)

    @property
    def torque_drive(self) -> str | None:
        """The drive if it is a torque or a current; None if it is a voltage or there is no drive."""
        return self.drive if self.drive != "voltage" else None

    @property
    def load(self) -> str | None:
        """The input that is a torque on the link, None if there is none."""
        return "external_torque" if "external_torque" in self.input_names else None

    def torque_constant(self, values: Mapping[str, float]) -> float:
        """Return the motor torque in Nm per unit of the `torque_drive`."""
        return values["k_t"] if self.torque_drive == "current" else 1.0

    def gear_ratio(self, values: Mapping[str, float]) -> float:
        """Return the turns of the motor per turn of the link, 1 without a gear."""
        return values.get("N", 1.0)

    @property
    def has_gravity(self) -> bool:
        """Whether the model has a load that depends on the angle of the link."""
        return "a_g" in self.parameter_names

    @property
    def has_torque_offset(self) -> bool:
        """Whether the model has a constant torque."""
        return "tau_0" in self.parameter_names

    @property
    def motor_constants(self) -> tuple[str, ...]:
        """Parameters that are the voltage constant and the torque constant of the motor; none without a circuit."""
        return ("k_b", "k_t") if self._own("k_b") else ()

    @property
    def motor_inertias(self) -> tuple[str, ...]:
        """Parameters that are an inertia at the motor."""
        return tuple(filter(None, (self._own("J_r"), self._own("J_m"))))

    @property
    def twist_offset(self) -> str | None:
        """Parameter that is the twist at which the encoders agree; None without."""
        return self._own("dtheta_0")

    @property
    def stiffness(self) -> str | None:
        """Parameter that is the linear stiffness of the gear; None without a spring."""
        return self._own("k_1")

    @property
    def gear_damping(self) -> str | None:
        """Parameter that is the damping of the gear's spring; None without."""
        return self._own("c_1")

    @property
    def cubic_stiffness(self) -> str | None:
        """Parameter that makes the spring of the gear stiffer under load; None without such a spring."""
        return self._own("k_2")

    @property
    def encoder_lag(self) -> str | None:
        """Parameter that is the delay of the link's encoder against the motor's; None without delays."""
        return self._own("delta_q")

    @property
    def drive_lag(self) -> str | None:
        """Parameter that is the delay of all encoders against the drive; None without delays."""
        return self._own("delta_p")

    def _own(self, name: str) -> str | None:
        return name if name in self.parameter_names else None

    def twist_under(self, drive: float, velocity: float, acceleration: float, p: Any) -> float:
        """Return the twist of the gear in rad, at the link, that balances the `torque_drive`; 0 for a rigid gear.

        `velocity` in rad/s and `acceleration` in rad/s^2 are those of the motor; `p` has one attribute per parameter.
        """
        return 0.0

    @property
    def optional_inputs(self) -> frozenset[str]:
        """Inputs that are taken as zero if the recording does not have them."""
        return frozenset({"external_torque"})

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Channel names of the states."""
        return tuple(s.name for s in self.states)

    @cached_property
    def input_names(self) -> tuple[str, ...]:
        """Channel names of the inputs."""
        return tuple(s.name for s in self.inputs)

    @cached_property
    def rates(self) -> tuple[int | None, ...]:
        """By input, the index of the input that is its time derivative; None if there is none, or if it is held.

        Between two samples such an input q with the rate v runs along q_0 + a (q_1 - q_0) - a (1 - a) h (v_1 - v_0) / 2
        at the share a of the step h: on a straight line, a moving link would always be on the inner side of its curve.
        """
        names = self.input_names
        found = (derivative_of(s.name) if s.hold == "first" else None for s in self.inputs)
        return tuple(names.index(rate) if rate in names else None for rate in found)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters, fixed ones included.

        Raises:
            JointIdError: two have the same name.
        """
        names = tuple(p.name for p in self.parameters)
        if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
            raise JointIdError(f"model {self.name} has two parameters {twice[0]!r}: give one of them another name")
        return names

    @cached_property
    def smoothing(self) -> dict[str, str]:
        """Velocity states with Coulomb friction, each with the name of its smoothing velocity.

        They are found by a call of the derivative, so that a model need not declare them separately.

        Raises:
            JointIdError: the derivative uses a parameter that the model does not have.
        """
        seen: dict[str, str] = {}

        class Named(float):
            name: str

        class Recorder:
            def __getattr__(self, _: str) -> Any:
                return lambda value: value

            def direction(self, velocity: str, w: Any, w_s: Any) -> float:
                seen[velocity] = w_s.name
                return 1.0

        p = SimpleNamespace()
        for name in self.parameter_names:
            value = Named(1.0)
            value.name = name
            setattr(p, name, value)
        try:
            self.derivative([0.0] * len(self.states), [0.0] * len(self.inputs), p, Recorder())
        except AttributeError as error:
            if error.obj is not p:
                raise
            raise JointIdError(
                f"model {self.name}: its derivative uses p.{error.name}, which is no parameter"
                f"{close_to(error.name, self.parameter_names)}: it has {', '.join(self.parameter_names)}"
            ) from None
        return seen

    @property
    def friction_states(self) -> tuple[str, ...]:
        """Velocity states with Coulomb friction."""
        return tuple(self.smoothing)

    def parameter(self, name: str) -> Parameter:
        """Return the parameter called `name`.

        Raises:
            JointIdError: the model has no such parameter.
        """
        for p in self.parameters:
            if p.name == name:
                return p
        from joint_id_core.models.lacking import option_for

        option = option_for(self, name)
        hint = f" without {option}" if option else close_to(name, self.parameter_names)
        raise JointIdError(
            f"model {self.name} has no parameter {name!r}{hint}: it has {', '.join(self.parameter_names)}"
        )

    def values(self, changes: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return the nominal values of all parameters with `changes`, after a check of names and bounds.

        Raises:
            JointIdError: unknown name, value out of bounds, or a parameter without default is not given.
        """
        changes = dict(changes or {})
        values = {p.name: p.nominal for p in self.parameters}
        for name, value in changes.items():
            values[name] = self.parameter(name).checked(value)
        for p in self.parameters:
            if values[p.name] != values[p.name]:
                raise JointIdError(
                    f"model {self.name} needs {p.name} ({p.meaning}, {p.unit}), which has no default: "
                    f"give it, e.g. --set {p.name}=..., or name a robot whose file has it (--robot ur3e, ur5e, ur10e)"
                )
        return values
