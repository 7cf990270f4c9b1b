"""Where a computed load is all that tells the torques of a joint, they are known no better than its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.load_errors import SampledErrors
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.load_size import size_deviation, with_size_doubt
from joint_id_core.models import build
from joint_id_core.online.published import with_computed_load
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict

MODEL = build("electromechanical")
NEEDED = {"N": 100.0, "J_q": 1.0}
BY_LOAD = ("k_t", "c_m", "tau_fm", "c_1", "k_1", "J_m", "J_q", "c_q")


def known(free: tuple[str, ...]) -> Estimate:
    """An estimate of these parameters, each known to a thousandth by itself."""
    values = MODEL.values(NEEDED) | {"k_2": 0.0, "c_b": 0.0, "tau_fq": 0.0}
    rows = tuple(
        ParameterEstimate(n, "1", v, 1e-3 * v, Verdict.ESTIMATED if n in free else Verdict.FIXED)
        for n, v in values.items()
    )
    covariance = np.diag([(1e-3 * values[n]) ** 2 for n in free])
    return Estimate(
        MODEL.name, "innovations", Status.CONVERGED, "Converged.", rows, free=free, covariance=covariance,
        notes=("Converged.",),
    )  # fmt: skip


def test_all_that_scales_with_the_torque_constant_moves_with_the_load():
    estimate = known(("R", "k_b", *BY_LOAD))
    found = with_size_doubt(MODEL, estimate, 0.2)
    for name in BY_LOAD:
        assert found[name].std_dev == pytest.approx(np.hypot(0.2, 1e-3) * found[name].value)
    for name in ("R", "k_b"):
        assert found[name] == estimate[name]
    logarithm = {name: 1.0 / found[name].value for name in found.free}
    ratio = np.array([logarithm[name] * ((name == "k_1") - (name == "k_t")) for name in found.free])
    assert np.sqrt(ratio @ found.covariance @ ratio) == pytest.approx(np.sqrt(2.0) * 1e-3)
    assert "k_t, J_m, c_m, tau_fm, c_1, k_1, J_q, c_q are known no better than the load, 20 %" in found.message
    assert with_size_doubt(MODEL, found, 0.2) is found, "it is said once"


@pytest.mark.parametrize(("derived", "share"), [(True, 0.2), (False, 0.0)], ids=["computed", "measured"])
def test_so_it_is_while_samples_arrive(derived, share):
    window, free = SlidingWindow(2.0), ("R", *BY_LOAD)
    samples = Recording(0.002 * np.arange(1000), {"voltage": np.ones(1000), "external_torque": np.ones(1000)})
    window.append(replace(samples, derived=frozenset({"external_torque"} if derived else ())))
    found = with_computed_load(known(free), window, MODEL)
    doubt = 0.01 if derived else 0.0  # of vibrations that a computed load lacks
    assert found["k_t"].std_dev == pytest.approx(np.sqrt(share**2 + doubt**2 + 1e-6) * found["k_t"].value)
    assert found["R"].std_dev < 0.011 * found["R"].value


def test_a_torque_constant_that_is_held_tells_the_scale():
    estimate = known(tuple(name for name in ("R", "k_b", *BY_LOAD) if name != "k_t"))
    assert with_size_doubt(MODEL, estimate, 0.2) is estimate


def test_so_does_another_torque_that_is_held():
    estimate = known(tuple(name for name in ("R", "k_b", *BY_LOAD) if name != "J_q"))
    assert with_size_doubt(MODEL, estimate, 0.2) is estimate


def recording(errors: np.ndarray, factors: np.ndarray) -> Recording:
    time = 0.01 * np.arange(len(errors))
    middle = SampledErrors(time + 0.005, errors, "a load")
    one = Recording(time, {"external_torque": errors @ factors}, derived=frozenset({"external_torque"}))
    return replace(one, load_errors=middle)


def test_the_size_of_a_load_varies_as_far_as_the_prior_of_its_errors_lets_it():
    """Against draws: factors from the prior, seen along the load that was found."""
    rng = np.random.default_rng(1)
    errors, computed = rng.standard_normal((400, 3)), np.array([3.0, -1.0, 2.0])
    one = recording(errors, computed)
    assert size_deviation([one], None, 1.0) == pytest.approx(1.0 / np.linalg.norm(computed), rel=1e-6)
    added, width = np.array([0.5, 0.5, -1.0]), 0.7
    whole = computed + added
    sizes = np.linspace(-3.0, 5.0, 200_001)  # of the load that was found: true factors are sizes * whole - computed
    cost = np.sum((sizes[:, None] * whole - computed) ** 2, axis=1) / width**2
    weight = np.exp(-0.5 * (cost - cost.min()))
    mean = np.sum(weight * sizes) / weight.sum()
    spread = np.sqrt(np.sum(weight * (sizes - mean) ** 2) / weight.sum())
    assert size_deviation([one], added, width) == pytest.approx(np.hypot(spread, mean - 1.0), rel=1e-3)


def test_without_errors_or_load_there_is_nothing_to_add():
    one = recording(np.ones((10, 2)), np.zeros(2))
    assert size_deviation([one], None, 1.0) == 0.0
    assert size_deviation([replace(one, load_errors=None)], None, 1.0) == 0.0
