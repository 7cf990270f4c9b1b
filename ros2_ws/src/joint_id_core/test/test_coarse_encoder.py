"""A joint with a coarse encoder, in ordinary work: single moves and rests, of which a window shows one or two."""

import functools

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators import Regression
from joint_id_core.filtering.offline import complete
from joint_id_core.models import build
from joint_id_core.online.identifier import OnlineIdentifier
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.position_control import simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .quick import first_quick
from .test_starts import Moves

TRUTH = {"J": 0.33, "c": 0.037, "tau_f": 0.37}
GRAVITY = {"a_g": -0.96, "b_g": 0.45}
STEP = 7e-4  # rad; in the middle of a move the joint passes one of them in a sample
RATE = 1000.0


@functools.cache
def worked(seed, gravity):
    """Six moves with rests of 0.3 s, with the noise that rounding is."""
    model = build("rigid_joint", gravity=gravity)
    truth = model.values(TRUTH | (GRAVITY if gravity else {}))
    time = np.arange(round(7.0 * RATE)) / RATE
    moved = simulate_closed_loop(model, controller_of(model, truth), Moves(seed, 0.3), time, truth, torque_noise=2e-3)
    shown = Sensors(quantum={"link_position": STEP}).measure(
        Recording(time, {n: moved[n] for n in ("link_position", "torque")}, source="work"), seed=seed
    )
    return model, truth, shown


@pytest.mark.parametrize("gravity", first_quick([True, False]))
@pytest.mark.parametrize("seed", first_quick([1, 2, 3, 4]))
def test_online_windows_of_single_moves_show_no_load_that_is_not_there(seed, gravity):
    model, truth, shown = worked(seed, gravity)
    joint, samples, found = OnlineIdentifier(model), complete(shown), []
    for k in range(0, len(samples), 100):
        if (estimate := joint.update(samples.slice(k, k + 100))) is not None and not estimate.status.unusable:
            found.append(estimate)
    assert any(estimate.converged for estimate in found)
    # one move tells little: the second estimator may be wrong there by itself, and both are in the interval then
    doubtful = [estimate for estimate in found if estimate.status is Status.DISAGREE]
    assert len(doubtful) <= 1
    for estimate in found:
        assert estimate in doubtful or "a load" not in estimate.message.lower()
        for name in estimate.free if estimate.converged else ():
            assert abs(estimate[name].value - truth[name]) < 4.0 * estimate[name].std_dev, name


@pytest.mark.long
def test_noise_of_an_encoder_that_is_rounding_is_no_motion():
    """Its peaks at high frequencies would widen the band, and noise of the acceleration make the inertia smaller."""
    found = []
    for seed in (1, 2, 3, 4):
        model, truth, shown = worked(seed, True)
        windows = [Regression().fit(model, shown.slice(k, k + 2000)) for k in range(0, len(shown) - 2000, 500)]
        found += [estimate["J"].value / truth["J"] for estimate in windows if not estimate.status.unusable]
    low, middle, high = np.quantile(found, [0.25, 0.5, 0.75])
    assert middle == pytest.approx(1.0, abs=0.1)
    assert low > 0.8 and high < 1.2
