"""Parameters that enter a model only in combination, and what the fit says of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from joint_id_core.data.signals import channel, positive
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.combinations import combinations
from joint_id_core.results.estimate import Verdict
from joint_id_core.results.report import table
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick


def free_of(model, *freed):
    return tuple(p.name for p in model.parameters if not p.fixed or p.name in freed)


def free_models():
    """Every model with every friction law, as its table frees it."""
    return [(name, law) for name in MODELS for law in LAWS]


@pytest.mark.parametrize("name, law", free_models())
def test_no_model_frees_what_cannot_be_known(name, law):
    model = build(name, friction=law)
    assert combinations(model, free_of(model), frozenset({"external_torque"})) == ()


def test_bearing_and_gear_friction_are_known_as_a_sum():
    model = build("electromechanical")
    (found,) = combinations(model, free_of(model, "c_b"))
    assert set(found.names) == {"c_b", "c_m"} and found.kind == "sum"
    assert found.text in ("c_b + c_m", "c_m + c_b")


def test_a_torque_constant_without_a_known_load_is_one_scale_of_everything():
    model = build("harmonic_drive", actuation="current")
    free = free_of(model, "k_t")
    (found,) = combinations(model, free, frozenset({"external_torque"}))
    assert found.kind == "scale" and set(found.names) == set(free)
    assert found.text.startswith("J_m, c_m, tau_fm")
    assert combinations(model, free) == ()  # a measured load torque sets the scale


def test_two_offsets_of_a_linear_spring_are_one():
    model = build("motor_side")
    free = tuple(name for name in free_of(model, "dtheta_0") if name != "k_2")
    (found,) = combinations(model, free, frozenset({"k_2"}))
    assert set(found.names) == {"tau_0", "dtheta_0"}
    assert combinations(model, free) == ()  # the cubic part tells them apart


def any_null_basis(seed):
    """`numpy.linalg.svd`, but with the basis of the null space rotated at random: every such basis is right."""
    rng, exact = np.random.default_rng(seed), np.linalg.svd

    def svd(a, full_matrices=True, compute_uv=True, hermitian=False):
        u, s, vt = exact(a, full_matrices=full_matrices)
        rank = int(np.sum(s > 1e-9 * s.max(initial=1e-300)))
        null = len(vt) - rank
        vt[rank:] = np.linalg.qr(rng.standard_normal((null, null)))[0] @ vt[rank:]
        return (u, s, vt) if compute_uv else s

    return svd


def described(model, free, zero=frozenset()):
    """What is found, computed anew."""
    found = combinations.__wrapped__(model, free, zero)
    return [(c.names, c.kind, c.text, tuple(f"{w:.6g}" for w in c.weights)) for c in found]


@dataclass(frozen=True)
class Pump(Model):
    """A rotor whose torque is a product of two constants, with a brake that is a difference of two."""

    name = "pump"
    summary = "rotor with redundant constants"

    @property
    def states(self):
        return (channel("link_velocity"),)

    @property
    def inputs(self):
        return (channel("torque"),)

    @property
    def parameters(self):
        return tuple(positive(n, "1", n, v) for n, v in (("a", 2.0), ("b", 3.0), ("c", 5.0), ("d", 1.0), ("e", 7.0)))

    def derivative(self, x, u, p, ops):
        return (p.a * p.b * u[0] - (p.c - 2.0 * p.d) * x[0] - p.a**0 * ops.sin(x[0]) * p.e,)


def test_products_and_weighted_differences_are_named():
    found = {frozenset(c.names): c for c in combinations(Pump(), ("a", "b", "c", "d", "e"))}
    product, difference = found[frozenset("ab")], found[frozenset("cd")]
    assert (product.kind, difference.kind) == ("product", "sum")
    assert product.text == "a * b"
    assert difference.text == "c - 2 d"
    covariance = np.diag([0.04, 0.09, 1.0, 0.25])
    value, sd = difference.value(dict(a=2.0, b=3.0, c=5.0, d=1.0), ("a", "b", "c", "d"), covariance)
    assert (value, sd) == pytest.approx((3.0, np.sqrt(1.0 + 4 * 0.25)))
    value, sd = product.value(dict(a=2.0, b=3.0, c=5.0, d=1.0), ("a", "b", "c", "d"), covariance)
    assert (value, sd) == pytest.approx((6.0, np.sqrt(9 * 0.04 + 4 * 0.09)))


@dataclass(frozen=True)
class Tangle(Model):
    """Combinations of every kind at once: a sum of three, an offset in two places, a product under a sum, a scale."""

    name = "tangle"
    summary = "everything at once"

    @property
    def states(self):
        return channel("motor_velocity"), channel("link_velocity")

    @property
    def inputs(self):
        return (channel("torque"),)

    @property
    def parameters(self):
        return tuple(positive(n, "1", n, float(k + 2)) for k, n in enumerate("abcdefghijklmno"))

    def derivative(self, x, u, p, ops):
        scaled = (p.d * u[0] - p.e * x[0] - p.f * ops.sin(x[0])) / p.g
        return scaled + (p.a + 2.0 * p.b - p.c) * x[1], p.h * (p.i + p.j) * x[1] + p.k * p.l / p.m * u[0] + p.n**2


def tangled():
    model = Tangle()
    return model, tuple(reversed(model.parameter_names))


def several():
    """Models with combinations, each with the names of what is free and of the inputs that are zero."""
    motor, drive = build("electromechanical"), build("harmonic_drive", actuation="current")
    zero = frozenset({"external_torque"})
    return {
        "pump": (Pump(), tuple("abcde"), frozenset()),
        "tangle": (*tangled(), frozenset()),
        "all of the motor": (motor, motor.parameter_names, zero),
        "all of the drive": (drive, drive.parameter_names, zero),
    }


@pytest.mark.parametrize("case", first_quick(several()))
def test_the_combinations_do_not_depend_on_the_basis_that_the_decomposition_returns(case, monkeypatch):
    model, free, zero = several()[case]
    expected = described(model, free, zero)
    assert expected
    for seed in range(20):
        with monkeypatch.context() as patch:
            patch.setattr(np.linalg, "svd", any_null_basis(seed))
            assert described(model, free, zero) == expected


@pytest.mark.parametrize("case", several())
def test_the_combinations_do_not_depend_on_the_order_in_which_parameters_are_freed(case):
    model, free, zero = several()[case]
    shuffled = np.random.default_rng(1).permutation(free).tolist()
    assert described(model, tuple(shuffled), zero) == described(model, free, zero)


def test_combinations_of_every_kind_are_told_apart():
    texts = {text: kind for _, kind, text, _ in described(*tangled())}
    assert texts == {
        "a + 2 b - c": "sum",
        "d, e, f, g": "scale",
        "h, i, j": "other",
        "i + j": "sum",
        "k * l / m": "product",
        "o": "other",
    }


@pytest.fixture(scope="module")
def steps():
    """Two seconds of Model 3 under steps of voltage, all states measured."""
    model = build("electromechanical")
    time = np.arange(2000) * 1e-3
    motion = simulate(model, time, {"voltage": np.repeat([12.0, -12.0, 6.0, -6.0], 500)})
    noise = {
        "current": 0.05, "motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3
    }  # fmt: skip
    return Sensors(noise=noise).measure(motion, 1)


def test_a_fit_names_the_combination_with_its_value(steps):
    model = build("electromechanical")
    estimate = fit(model, steps, ParameterSettings(freed=("c_b",)))
    truth = model.values()
    for name in ("c_b", "c_m"):
        assert estimate[name].verdict is Verdict.PRIOR
        assert "c_b + c_m = 0.0305" in estimate[name].reason
    assert "This model shows only c_b + c_m = 0.0305" in estimate.message
    assert "c_b: this model shows only c_b + c_m" in table(estimate)
    (group,) = combinations(model, estimate.free, frozenset({"external_torque"}))
    value, sd = group.value(estimate.values, estimate.free, estimate.covariance)
    assert abs(value - truth["c_b"] - truth["c_m"]) < 4.0 * sd < 0.01 * value
    held = fit(model, steps)
    assert held["c_m"].verdict is Verdict.ESTIMATED and "times" in held["c_m"].reason


def test_what_a_motion_does_not_show_is_said_with_the_reason(steps):
    """One short step: the twist stays small, the cubic stiffness is not seen."""
    estimate = fit(build("electromechanical"), steps.window(0.0, 0.15))
    assert estimate["k_2"].verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)
    assert "does not show it" in estimate["k_2"].reason or "more is not known" in estimate["k_2"].reason
    assert "k_2: " in table(estimate)
