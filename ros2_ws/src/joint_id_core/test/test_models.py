"""Joint models: closed forms, power balance, friction laws, names and bounds."""

import dataclasses
import math
import pickle
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.signals import CHANNELS, Parameter, channel, positive
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import (
    LAWS,
    MODELS,
    DCMotor,
    Electromechanical,
    HarmonicDrive,
    MotorSide,
    RigidJoint,
    build,
)
from joint_id_core.models.operations import SignOps, SmoothOps

number = st.floats(-2.0, 2.0)
speed = st.floats(-200.0, 200.0)

VARIANTS = [
    DCMotor(), DCMotor(friction="stribeck"), DCMotor(friction="eyring"),
    HarmonicDrive(), HarmonicDrive("current", "stribeck", True, True),
    Electromechanical(), Electromechanical("eyring", True, True),
    RigidJoint(), RigidJoint("current", "stribeck", True),
    MotorSide(), MotorSide("current", "eyring", True),
]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Mistaken(RigidJoint):
    name = "mistaken"

    def derivative(self, x, u, p, ops):
        return x[1], u[0] / p.J_q


@dataclasses.dataclass(frozen=True)
class Doubled(RigidJoint):
    name = "doubled"

    @property
    def parameters(self):
        return (*super().parameters, positive("J", "kg m^2", "test", 1.0))


def evaluate(model, x, u, ops=None, **changes):
    p = model.values({**({"k_t": 0.1} if "k_t" in model.parameter_names else {}), **changes})
    return model.derivative(x, u, SimpleNamespace(**p), ops or SignOps()), SimpleNamespace(**p)


@given(i=number, w=speed, v=st.floats(-48, 48), load=number)
def test_dc_motor_is_the_papers_equations_4_to_6(i, w, v, load):
    (di, dw), p = evaluate(DCMotor(), [i, w], [v, load])
    sign = math.copysign(1.0, w) if w else 0.0
    assert v == pytest.approx(p.L * di + p.R * i + p.k_b * w, abs=1e-9)
    assert p.k_t * i == pytest.approx(p.J_r * dw + p.c_b * w + p.tau_fc * sign + load, abs=1e-9)


@given(theta=speed, q=number, w=speed, dq=number, tau=number, load=number)
def test_harmonic_drive_is_the_papers_equations_7_to_11(theta, q, w, dq, tau, load):
    q = theta / 101.0 + 1e-3 * q
    (v_m, v_q, dw, ddq), p = evaluate(HarmonicDrive(), [theta, q, w, dq], [tau, load])
    twist, rate = theta / 101.0 - q, w / 101.0 - dq
    spring = 5164.0 * twist + 9.021e8 * twist**3 + 18.938 * rate

    def sign(value):
        return (value > 0) - (value < 0)

    assert (v_m, v_q) == (w, dq)
    assert p.J_m * dw == pytest.approx(tau - 1.018e-4 * w - 2.291e-2 * sign(w) - spring / 101.0, abs=1e-9)
    assert p.J_q * ddq == pytest.approx(spring - 1.799 * dq - 2.296 * sign(dq) - load, abs=1e-9)


@given(i=number, theta=speed, q=number, w=speed, dq=number, v=st.floats(-48, 48), load=number)
def test_electromechanical_is_models_1_and_2_joined(i, theta, q, w, dq, v, load):
    q = theta / 101.0 + 1e-3 * q
    joined, p = evaluate(Electromechanical(), [i, theta, q, w, dq], [v, load])
    shared = {n: getattr(p, n) for n in HarmonicDrive().parameter_names}
    shared["c_m"] += p.c_b
    mechanical, _ = evaluate(HarmonicDrive(), [theta, q, w, dq], [p.k_t * i, load], **shared)
    electrical, _ = evaluate(DCMotor(), [i, w], [v, 0.0], R=p.R, L=p.L, k_b=p.k_b)
    assert joined[0] == pytest.approx(electrical[0])
    assert joined[1:] == pytest.approx(mechanical, rel=1e-9, abs=1e-6)


@given(theta=speed, q=number, w=speed, dq=number, tau=number)
def test_motor_side_is_the_motor_half_of_the_harmonic_drive(theta, q, w, dq, tau):
    q = theta / 101.0 + 1e-3 * q
    whole, _ = evaluate(HarmonicDrive(), [theta, q, w, dq], [tau, 0.0])
    shared = {n: v for n, v in HarmonicDrive().values().items() if n in MotorSide().parameter_names}
    half, _ = evaluate(MotorSide(), [theta, w], [tau, q, dq], **shared)
    assert half == pytest.approx((whole[0], whole[2]))
    offset, _ = evaluate(MotorSide(), [theta, w], [tau + 0.1, q - 1e-3, dq], **shared, tau_0=0.1, dtheta_0=1e-3)
    assert offset[1] == pytest.approx(half[1], rel=1e-9, abs=1e-3)  # the twist is a difference of large angles


@given(q=number, dq=number, tau=number, load=number)
def test_rigid_joint_is_newtons_law_at_the_link(q, dq, tau, load):
    changes = {"J": 3.0, "c": 2.0, "tau_f": 4.0, "tau_0": 0.5, "N": 50.0, "a_g": 6.0, "b_g": 7.0}
    (v, ddq), _ = evaluate(RigidJoint(gravity=True), [q, dq], [tau, load], **changes)
    sign = (dq > 0) - (dq < 0)
    rest = 50 * tau - 2 * dq - 4 * sign - 0.5 - load - 6 * math.cos(q) - 7 * math.sin(q)
    assert v == dq
    assert 3 * ddq == pytest.approx(rest, abs=1e-9)


@given(theta=speed, q=number, w=speed, dq=number, i=number, v=st.floats(-48, 48), a_ke=st.floats(-1e-3, 1e-3))
def test_power_in_is_power_stored_dissipated_and_given_out(theta, q, w, dq, i, v, a_ke):
    """d(stored energy)/dt from the derivative equals electrical power minus every loss.

    The kinematic error turns the spring by theta_ke, whose rate does no work in the model (paper Eq 8 puts it
    into i_HD only): its power appears as the exact difference.
    """
    model, q = Electromechanical(gravity=True, kinematic_error=True), theta / 101.0 + 1e-3 * q
    changes = {"k_t": 0.055, "k_b": 0.055, "a_ke": a_ke, "phi_ke": 0.3, "a_g": 5.0, "b_g": 16.0, "tau_fq": 2.0}
    (di, v_m, v_q, dw, ddq), p = evaluate(model, [i, theta, q, w, dq], [v, 1.5], **changes)
    twist, rate = theta / p.N - q, v_m / p.N - v_q
    spring = p.k_1 * twist + p.k_2 * twist**3
    gravity = p.a_g * math.cos(q) + p.b_g * math.sin(q)
    stored = p.L * i * di + p.J_m * w * dw + p.J_q * dq * ddq + spring * rate + gravity * v_q
    lost = p.R * i**2 + (p.c_b + p.c_m) * w**2 + p.tau_fm * abs(w) + p.c_q * dq**2 + p.tau_fq * abs(dq)
    lost += p.c_1 * rate**2
    error = 2 * a_ke * math.cos(2 * theta + 0.3) * w * (spring + p.c_1 * rate)
    scale = abs(v * i) + lost + abs(spring * rate) + abs(error) + 1.0
    assert stored == pytest.approx(v * i - lost - 1.5 * dq - error, abs=1e-9 * scale)


def friction(law, w, ops=None, **changes):
    """Friction torque at a rigid joint with unit inertia."""
    changes = {"J": 1.0, "c": 2.0, "tau_f": 5.0, **changes}
    (_, a), _ = evaluate(RigidJoint(friction=law), [0.0, w], [0.0, 0.0], ops, **changes)
    return -a


@given(w=st.floats(1e-6, 10.0))
def test_friction_laws_are_what_their_names_say(w):
    assert friction("coulomb_viscous", w) == pytest.approx(5 + 2 * w)
    stribeck = {"dtau_s": 3.0, "w_b": 0.5}
    assert friction("stribeck", w, **stribeck) == pytest.approx(5 + 3 * math.exp(-((w / 0.5) ** 2)) + 2 * w)
    assert friction("eyring", w, w_e=0.5) == pytest.approx(5 + 2 * 0.5 * math.asinh(w / 0.5))


@given(w=st.floats(1e-3, 50.0), law=st.sampled_from(LAWS))
def test_friction_is_odd_and_always_opposes_the_motion(w, law):
    for ops in (SignOps(), SmoothOps()):
        assert friction(law, w, ops) > 0.0
        assert friction(law, -w, ops) == -friction(law, w, ops)


def test_friction_laws_in_their_limits():
    assert friction("stribeck", 1e-9, dtau_s=3.0, w_b=0.5) == pytest.approx(8.0)  # static level at rest
    assert friction("stribeck", 50.0, dtau_s=3.0, w_b=0.5) == pytest.approx(5 + 100)
    assert friction("eyring", 1e-4, w_e=0.5) - 5 == pytest.approx(2e-4, rel=1e-6)  # slope c at rest
    assert friction("eyring", 10.0, w_e=0.5) - 5 < 0.5 * 2 * 10  # which falls with speed
    assert friction("coulomb_viscous", 0.0) == 0.0
    assert friction("coulomb_viscous", 1.0, SmoothOps(), w_s=0.01) == pytest.approx(7.0)
    assert friction("coulomb_viscous", 0.01, SmoothOps(), w_s=0.01) == pytest.approx(5 * math.tanh(1) + 0.02)


@pytest.mark.parametrize("model", VARIANTS, ids=repr)
def test_every_model_is_consistent(model):
    assert len(set(model.parameter_names)) == len(model.parameter_names)
    assert set(model.state_names) | set(model.input_names) <= set(CHANNELS)
    assert not set(model.state_names) & set(model.input_names)
    assert set(model.friction_states) <= set(model.state_names)
    for p in model.parameters:
        assert p.unit and p.meaning
        assert math.isnan(p.nominal) or p.lower <= p.nominal <= p.upper
    dx, _ = evaluate(model, [0.1] * len(model.states), [0.1] * len(model.inputs), SmoothOps())
    assert len(dx) == len(model.states)
    assert all(isinstance(d, float) and math.isfinite(d) for d in dx)


@pytest.mark.parametrize("model", VARIANTS, ids=repr)
def test_every_parameter_acts_on_the_derivative(model):
    # Slow, so that the laws for small velocities show, and with a small twist.
    point = {"motor_position": 0.3, "link_position": 0.002, "motor_velocity": 0.3, "link_velocity": 0.004}
    x, u = [point.get(n, 0.5) for n in model.state_names], [point.get(n, 0.4) for n in model.input_names]
    base = {"tau_fq": 1.0} if "tau_fq" in model.parameter_names else {}  # else w_sq has nothing to smooth
    nominal, p = evaluate(model, x, u, SmoothOps(), **base)
    for parameter in model.parameters:
        changed = {**base, parameter.name: getattr(p, parameter.name) * 1.01 + 1e-5}
        assert evaluate(model, x, u, SmoothOps(), **changed)[0] != nominal, parameter.name


@pytest.mark.parametrize("model", VARIANTS, ids=repr)
def test_models_are_values(model):
    """Equal, hashable and the same after pickling, also once they have been used."""
    fresh = dataclasses.replace(model)
    evaluate(model, [0.1] * len(model.states), [0.1] * len(model.inputs))
    assert model == fresh
    assert hash(model) == hash(fresh)
    assert pickle.loads(pickle.dumps(model)) == fresh


def test_what_the_paper_prints_is_nominal():
    table_1 = {"R": 0.4932, "k_b": 0.05794, "k_t": 0.05507, "c_b": 2.537e-4, "tau_fc": 0.04464}
    table_3 = {"c_m": 0.0304, "c_1": 7.1, "k_1": 8000.0, "k_2": 4e5, "tau_fm": 0.04464, "c_q": 40.31, "c_b": 1.459e-4}
    table_5 = {"k_1": 5164.0, "k_2": 9.021e8, "c_1": 18.938, "c_m": 1.018e-4, "tau_fm": 0.02291, "J_q": 0.778}
    for model, table in ((DCMotor(), table_1), (Electromechanical(), table_3), (HarmonicDrive(), table_5)):
        assert {n: model.values()[n] for n in table} == pytest.approx(table)


def test_models_are_built_by_name_with_their_options():
    assert set(MODELS) == {"dc_motor", "harmonic_drive", "electromechanical", "rigid_joint", "motor_side"}
    for name in MODELS:
        assert build(name).name == name
    model = build("harmonic_drive", actuation="current", friction="stribeck", gravity=True, kinematic_error=True)
    assert model.input_names == ("current", "external_torque")
    assert {"k_t", "w_bm", "w_bq", "a_g", "a_ke"} <= set(model.parameter_names)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: build("robot"), "unknown model 'robot': choose one of dc_motor"),
        (lambda: build("dc_motor", gravity=True), "dc_motor has no option 'gravity': it has friction"),
        (lambda: build("dc_motor", friction="sticky"), "unknown friction law 'sticky'"),
        (lambda: build("dc_motor", friction=3), "unknown friction law 3: choose one of coulomb_viscous"),
        (lambda: build("motor_side", actuation="curent"), r"unknown actuation 'curent' \(did you mean current\?\)"),
        (lambda: build("rigid_joint", actuation="voltage"), "unknown actuation 'voltage': choose one of torque, cur"),
        (lambda: build("rigid_joint", gravity="false"), "model rigid_joint: gravity = 'false': give True or False"),
        (lambda: HarmonicDrive(offsets=1), "model harmonic_drive: offsets = 1: give True or False"),
        (lambda: DCMotor().parameter("k_1"), r"dc_motor has no parameter 'k_1' \(did you mean k_t\?\): it has R"),
        (lambda: DCMotor().values({"k_1": 1.0}), "no parameter 'k_1'"),
        (lambda: DCMotor().values({"R": -1.0}), r"R = -1 Ohm is outside its bounds \[0, inf\]"),
        (lambda: DCMotor().values({"R": math.nan}), "R = nan: must be a finite number in Ohm"),
        (lambda: build("harmonic_drive").values({"N": 0.0}), "N = 0 is outside its bounds"),
        (lambda: build("harmonic_drive").values({"N": math.nan}), "N = nan: must be a finite number$"),
        (lambda: RigidJoint().values({"w_s": 0.0}), "w_s = 0 rad/s is outside"),
        (lambda: RigidJoint("current").values(), r"needs k_t .* no default.*--set k_t"),
        (lambda: HarmonicDrive().parameter("k_t"), "no parameter 'k_t' without --actuation current: it has J_m"),
        (lambda: RigidJoint().parameter("w_b"), "no parameter 'w_b' without --friction stribeck"),
        (lambda: HarmonicDrive(drifting_load=True).parameter("delta_q"), "no parameter 'delta_q' without --delays"),
        (
            lambda: Mistaken().smoothing,
            r"model mistaken: its derivative uses p.J_q, which is no parameter: it has J, c, tau_f",
        ),
        (lambda: ParameterSettings().applied_to(Mistaken()), "model mistaken: its derivative uses p.J_q"),
        (lambda: Doubled().parameter_names, "model doubled has two parameters 'J': give one of them another name"),
    ],
)
def test_misuse_is_one_clear_line(call, message):
    with pytest.raises(JointIdError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_parameters_check_their_bounds_and_know_whether_they_are_positive():
    p = Parameter("a", "1", "test", 0.0, -1.0, 1.0)
    assert not p.positive
    assert p.checked(1.0) == 1.0
    assert p.with_nominal(0.5).nominal == 0.5
    with pytest.raises(JointIdError, match="outside its bounds"):
        p.with_nominal(1.5)
    assert positive("b", "Nm", "test", 2.0).positive
    assert channel("link_position", hold="first").hold == "first"
    assert CHANNELS["link_position"].hold == "zero"


def test_only_what_no_robot_records_may_be_missing():
    for name in MODELS:
        model = build(name)
        assert model.optional_inputs.intersection(model.input_names) <= {"external_torque"}
    drifting = build("harmonic_drive", drifting_load=True)
    assert drifting.optional_inputs.intersection(drifting.input_names) == {"external_torque", "load_rate"}
