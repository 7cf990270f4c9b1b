"""Noise levels that follow the samples, and what their uncertainty adds to that of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.noise import UNKNOWN
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.online.block import Block
from joint_id_core.online.levels import DOUBTED, MOST_LOST, Levels
from joint_id_core.online.noise_effects import noise_information
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.piece import Samples
from joint_id_core.simulation.minimum_jerk import minimum_jerk
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .online_motion import NOISE, batches, motion

MODEL = build("harmonic_drive", actuation="current")
KNOWN = {"k_t": 0.1, "N": 101.0}
FREE = [p.name for p in MODEL.parameters if not p.fixed]
SENSORS = Sensors(noise={"link_position": 1e-5, "motor_velocity": 0.1})
TORQUE_NOISE = 0.003  # Nm


@dataclass(frozen=True)
class Steps:
    """Moves of 0.4 s and rests of 0.3 s, to and fro, over distances that change; or smaller and slower ones."""

    size: float = 1.0
    tempo: float = 1.0

    def _place(self, time):
        k, t = divmod(self.tempo * time, 0.7)
        begin, end = self.size * np.sin(5.0 * k), self.size * np.sin(5.0 * (k + 1.0))
        return begin, end - begin, min(1.0, t / 0.4)

    def value(self, time):
        begin, way, x = self._place(time)
        return begin + way * minimum_jerk(x)[0]

    def rate(self, time):
        _, way, x = self._place(time)
        return self.tempo * way / 0.4 * minimum_jerk(x)[1]


STEPS = Steps()


def ordinary(seed, samples, reference=STEPS):
    """Return what the sensors of a controlled joint show, and its parameters."""
    rng = np.random.default_rng(seed)
    truth = {n: MODEL.values(KNOWN)[n] * rng.uniform(0.9, 1.1) for n in FREE}
    record = simulate_closed_loop(
        MODEL, PositionController(), reference, np.arange(samples) * 2e-3, {**KNOWN, **truth},
        torque_noise=TORQUE_NOISE, seed=seed, sensors=SENSORS,
    )  # fmt: skip
    return Recording(record.time, {n: record[n] for n in ("link_position", "motor_velocity", "current")}), truth


@pytest.mark.long
def test_parameters_of_a_controlled_joint_in_ordinary_motion_are_within_their_intervals():
    """The controller feeds the noise of the sensors back; levels 7 % too small moved inertias by 5 sigma."""
    errors = []
    for seed in range(3):
        shown, truth = ordinary(seed, 10_000)
        identifier = OnlineIdentifier(MODEL, ParameterSettings(KNOWN))
        found = [e for e in map(identifier.update, batches(shown, 50)) if e is not None]
        last = [e for e in found if e.converged][-1]
        errors += [(last[n].value - truth[n]) / last[n].std_dev for n in FREE]
        assert last.noise["motor_velocity"] == pytest.approx(0.1, rel=0.06)
        assert last.noise["input current"] == pytest.approx(TORQUE_NOISE / 0.1, rel=0.06)
        assert not last.changes
    assert np.max(np.abs(errors)) < 4.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.long
def test_intervals_of_a_fit_are_those_of_the_likelihood_in_slow_motion():
    """Held z standard deviations off, a parameter costs z^2 (Wilks), with all others and the noise levels fitted again.

    In slow motion much of what is known comes from how the joint answers to noise. At known levels, standard deviations
    would be so small that it costs 0.4 z^2. The records are of those with one credible minimum: where there are more,
    the intervals contain the distance between them, and are wider.
    """
    off, costs = 1.5, []
    for seed in (3, 6, 9):
        record, _ = ordinary(seed, 2000, Steps(size=0.3, tempo=0.5))
        best = fit(MODEL, record, ParameterSettings(KNOWN))
        assert not any("starts led to minima" in note for note in best.notes)
        start = {n: best[n].value for n in FREE}
        for by in (-off, off):
            held = start | {"J_m": best["J_m"].value + by * best["J_m"].std_dev}
            costs.append(fit(MODEL, record, ParameterSettings(KNOWN | held, fixed=("J_m",))).deviance - best.deviance)
    assert 0.6 < np.mean(costs) / off**2 < 1.5


@pytest.mark.long
def test_levels_are_learned_from_all_samples():
    """The spread of the level over seeds is that of all samples, a fifth of that of a window."""
    shares = []
    for seed in range(6):
        identifier = OnlineIdentifier(build("rigid_joint"))
        found = [e for e in map(identifier.update, batches(motion(24.0, seed))) if e is not None]
        shares.append(found[-1].noise["link_position"] / NOISE)
    assert np.abs(np.log(shares)).max() < 4.0 / np.sqrt(2.0 * 24.0 * 250.0)


def test_doubted_levels_are_learned_anew_from_the_samples_since_then():
    """What those before showed is kept in part, so these are not learned from again."""
    identifier = OnlineIdentifier(build("rigid_joint"))
    for batch in batches(motion(6.0, 0)):
        identifier.update(batch)
    follower = identifier._known.follower
    tracker, levels, newest = follower.tracker, follower.levels, follower.memory.blocks[-1]
    levels.doubt(since=newest.begin.time)
    before, more = levels._information, noise_information(tracker, newest).matrix
    follower._refined._learn_noise(tracker, [newest], anew=True)
    kept = np.exp(-newest.duration / identifier.options.memory_s)
    np.testing.assert_allclose(levels._information, kept * before + more, rtol=1e-9)


def test_what_passes_in_parts_have_stored_tells_the_noise_as_one_pass_does():
    shown, _ = ordinary(4, 3000)
    identifier = OnlineIdentifier(MODEL, ParameterSettings(KNOWN))
    for part in batches(shown, 50):
        identifier.update(part)
    tracker = identifier._known.follower.tracker
    whole = identifier._known.follower.memory.blocks[-1]
    tracker._state, edges = whole.begin, [0, 1, 40, 41, 180, len(whole.samples.time)]
    tracker._take(whole.z)
    block = Block(tracker._state, whole.z, tracker.smoothing, tracker.levels, tracker._sizes, 7)  # which has to grow
    for a, b in pairwise(edges):
        samples = Samples(whole.samples.time[a:b], whole.samples.u[a:b], whole.samples.y[a:b])
        assert tracker._put(block, samples)
    piece = block.piece()
    found, expected = noise_information(tracker, piece), noise_information(tracker, replace(whole, passed=None))
    np.testing.assert_allclose(piece.matrix, tracker.passed_again(whole, tracker.levels).matrix, rtol=1e-9)
    np.testing.assert_allclose(piece.white, tracker.passed_again(whole, tracker.levels).piece().white, rtol=1e-6)
    for name in ("score", "matrix", "cross"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6, atol=1e-6)


def test_samples_may_be_columns_of_a_table():
    shown, _ = ordinary(4, 1500)
    names = list(shown.channels)
    table = np.column_stack([shown.time, *(shown[n] for n in names)])
    columns = Recording(table[:, 0], {n: table[:, k + 1] for k, n in enumerate(names)})
    found = []
    for samples in (shown, columns):
        identifier = OnlineIdentifier(MODEL, ParameterSettings(KNOWN), OnlineOptions(hop_s=0.02))
        found.append([e for part in batches(samples, 10) if (e := identifier.update(part)) is not None][-1])
    assert found[0].values == pytest.approx(found[1].values)


def widened(levels, inverse):
    wider = levels.wider(inverse)
    return wider @ inverse @ wider.T


@given(seed=st.integers(0, 1000), parameters=st.integers(1, 9), levels=st.integers(1, 4))
def test_uncertain_levels_widen_like_unknown_parameters(seed, parameters, levels):
    """The covariance is the block of the inverse of the whole information matrix."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((parameters + levels, 2 * (parameters + levels)))
    whole = root @ root.T
    k = parameters
    found = Levels(np.ones(levels), k)
    found._information, found._cross = whole[k:, k:] - UNKNOWN**-2 * np.eye(levels), whole[:k, k:]
    inverse = np.linalg.inv(whole[:k, :k])
    lost = 1.0 - 1.0 / np.max(np.linalg.eigvals(np.linalg.inv(whole)[:k, :k] @ whole[:k, :k]).real)
    wider = widened(found, inverse)
    if lost < MOST_LOST:
        np.testing.assert_allclose(wider, np.linalg.inv(whole)[:k, :k], rtol=1e-6, atol=1e-9)
    assert np.linalg.eigvalsh(wider - inverse).min() > -1e-9


def test_what_is_forgotten_widens_no_more():
    found = Levels(np.ones(2), 3)
    found._information, found._cross = 50.0 * np.eye(2), 5.0 * np.ones((3, 2))
    inverse = np.diag([0.1, 0.2, 0.3])
    found = found.changed([1], inverse, np.linalg.inv(inverse))
    wider = widened(found, inverse)
    assert wider[1, 1] == pytest.approx(0.2) and wider[0, 0] > 0.1 and wider[2, 2] > 0.3
    before = found._information.copy()
    found.doubt(since=0.0)
    np.testing.assert_allclose(found._information, DOUBTED * before)


@given(seed=st.integers(0, 1000), parameters=st.integers(2, 9), levels=st.integers(1, 4))
def test_parameters_that_did_not_change_depend_on_the_levels_as_before(seed, parameters, levels):
    """Their estimates move with a level by the same amount; the information stays positive definite.

    With the rows of the changed ones set to zero alone, a level that was learned anew moved the others by 77 standard
    deviations: what is known of these is less where the changed ones are not known any more.
    """
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((parameters + levels, 2 * (parameters + levels)))
    whole, k = root @ root.T, parameters
    changed = [0]
    found = Levels(np.ones(levels), k)
    found._information, found._cross = whole[k:, k:], whole[:k, k:]
    inverse = np.linalg.inv(whole[:k, :k])
    before = inverse @ found._cross
    after = inverse + np.diag([1e6, *np.zeros(k - 1)])
    found = found.changed(changed, inverse, np.linalg.inv(after))
    moved = after @ found._cross
    np.testing.assert_allclose(moved[1:], before[1:], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(moved[0], 0.0, atol=1e-6)
    joint = np.block([[np.linalg.inv(after), found._cross], [found._cross.T, found._information]])
    assert np.linalg.eigvalsh(joint).min() > -1e-8


def test_a_covariance_that_rounding_made_indefinite_is_widened_too():
    """Seen with an encoder that froze: parameters of very different units, some known only in combination."""
    one = np.array([1e6, 1.0, -1e-6])
    inverse = np.outer(one, one) * (1.0 - 1e-15 * np.eye(3))
    found = Levels(np.ones(2), 3)
    found._information, found._cross = 50.0 * np.eye(2), 1e-6 * np.ones((3, 2))
    wider = widened(found, inverse)
    assert np.isfinite(wider).all() and np.all(np.diag(wider) >= (1.0 - 1e-6) * np.diag(inverse))
