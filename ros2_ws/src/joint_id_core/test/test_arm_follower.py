"""An arm that is followed while it works: payloads, friction that changes, rests, and what nothing explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import CARRYING, CENTRE, COULOMB, JOINTS, MASS, RATE, ROTOR, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.belief import Belief
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations, equations
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.learning import learned
from joint_id_core.arm.payload import payload_of
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import MARGIN_S, ArmStream

ARM = Description(URDF, "arm.urdf")
REGRESSOR = Regressor(ARM)
GAINS = {name: {"torque": 1.0} for name in JOINTS}
Arm = Mapping[str, Recording]
LEARN, AFTER = 30.0, 15.0  # s of motion until something changes, and after it


def batches(arm: Arm, size: int = 50) -> list[dict[str, Recording]]:
    """Samples as they come from a filter."""
    count = len(arm[JOINTS[0]])
    return [{n: r.slice(k, k + size) for n, r in arm.items()} for k in range(0, count, size)]


def blocks(arm: Arm) -> list[Equations]:
    stream = ArmStream(REGRESSOR, GAINS, "arm.urdf")
    return [block for batch in batches(arm) for block in stream.push(batch)]


def followed(arm: Arm, belief: Belief | None = None) -> ArmFollower:
    follower = ArmFollower(JOINTS, ARM.mass, belief)
    for block in blocks(arm):
        follower.add(block)
    return follower


def with_torque(arm: Arm, added: Mapping[str, np.ndarray]) -> dict[str, Recording]:
    return {n: r.with_channels({"torque": r["torque"] + added[n]}) if n in added else r for n, r in arm.items()}


def carrying(seconds: float, seed: int, stretches: Sequence[tuple[float, float]]) -> dict[str, Recording]:
    """An arm that carries its payload in some stretches of time."""
    empty, loaded = (moving_arm.rigid(seconds, seed, urdf) for urdf in (URDF, CARRYING))
    time = empty[JOINTS[0]].time
    there = np.any([(time >= a) & (time < b) for a, b in stretches], axis=0)
    return {n: r.with_channels({"torque": np.where(there, loaded[n]["torque"], r["torque"])}) for n, r in empty.items()}


def off(belief: Belief) -> np.ndarray:
    base = REGRESSOR.reference + np.concatenate([ROTOR, np.zeros(belief.base - len(ROTOR))])
    place = np.r_[: belief.base, belief.friction][: belief.base + 2 * len(JOINTS)]  # friction does not bend
    truth = np.concatenate([base, VISCOUS, COULOMB])
    return (belief.values[place] - truth) / np.sqrt(np.diag(belief.covariance)[place])


def weighed(belief: Belief) -> tuple[float, float, np.ndarray]:
    place = belief.payload
    found = payload_of("plate", belief.values[place], belief.covariance[place, place])
    return found.mass, found.mass_std_dev, np.array(found.centre)


def test_batches_give_the_equations_of_the_whole():
    arm = moving_arm.rigid(6.0, 1)
    whole, parts = equations(REGRESSOR, arm, GAINS, "arm"), blocks(arm)
    assert parts[0].time[0] == pytest.approx(MARGIN_S) and len(parts) == 10
    for part in parts:
        rows = [int(np.argmin(np.abs(whole.time - t))) for t in part.time]
        np.testing.assert_allclose(whole.time[rows], part.time, atol=1e-6)
        columns, found = whole.columns[rows], part.columns[:, :, : whole.columns.shape[2]]  # those of friction follow
        size = np.abs(columns).max(axis=(0, 1)) + 1e-9
        np.testing.assert_allclose(found / size, columns / size, atol=5e-3)
        np.testing.assert_allclose(part.y, whole.y[rows], atol=0.05)


def test_an_arm_is_learnt_and_stays_honest():
    follower = followed(moving_arm.rigid(60.0, 2))
    assert follower.belief is not None and not follower.changes and not follower.unexplained
    z = off(follower.belief)
    assert np.abs(z).max() < 4.5 and 0.6 < np.sqrt(np.mean(z**2)) < 1.4


def test_a_payload_is_found_and_so_is_its_end():
    follower, told = ArmFollower(JOINTS, ARM.mass), []
    up, down = LEARN, LEARN + AFTER
    for block in blocks(carrying(down + AFTER, 0, [(up, down)])):
        before = dict(follower.changes)
        follower.add(block)
        if follower.changes != before:
            assert list(follower.changes) == ["payload"]
            told.append((float(block.time[-1]), follower.changes["payload"].since, follower.belief))
        if follower.belief is not None and follower.belief.carries:
            mass, sigma, centre = weighed(follower.belief)
    assert len(told) == 2
    for (when, since, _), truth in zip(told, (up, down), strict=True):
        assert truth - 0.6 < since < truth + 0.1 and when - truth < 3.0
    assert told[0][2].carries and not told[1][2].carries
    assert abs(mass - MASS) < 4.0 * sigma and sigma < 0.01 * MASS
    np.testing.assert_allclose(centre, CENTRE, atol=2e-3)
    assert np.abs(off(follower.belief)).max() < 4.5


@pytest.mark.long
@pytest.mark.parametrize("late", [0.25, 0.375], ids=["early in a stretch", "late in a stretch"])
def test_payloads_that_follow_one_another_are_told_each(late):
    masses, ends = (0.0, 1.0, MASS, 0.0, 1.0), np.array([LEARN, 37.0, 45.0, 53.0, 58.0]) + late
    arms = {m: moving_arm.rigid(ends[-1], 0, CARRYING.replace(f'value="{MASS}"', f'value="{m}"')) for m in (1.0, MASS)}
    arms[0.0] = moving_arm.rigid(ends[-1], 0)
    time = arms[0.0]["turn"].time
    carried = np.array(masses)[np.searchsorted(ends[:-1], time, side="right")]
    arm = {
        n: r.with_channels({"torque": np.select([carried == m for m in arms], [arms[m][n]["torque"] for m in arms])})
        for n, r in arms[0.0].items()
    }
    stream, follower, told = ArmStream(REGRESSOR, GAINS, "arm.urdf"), ArmFollower(JOINTS, ARM.mass), []
    for block in (block for batch in batches(arm) for block in stream.push(batch)):
        before = follower.changes.get("payload")
        if follower.add(block) and follower.belief is not None:
            stream.know(follower.belief.values, follower.belief.carries)
        if follower.changes.get("payload") is not before:
            told.append((block.time[-1], weighed(follower.belief)[0] if follower.belief.carries else 0.0))
    assert list(follower.changes) == ["payload"] and len(told) == len(masses) - 1
    for (when, found), end, mass in zip(told, ends, masses[1:], strict=False):
        assert end < when < end + 3.0 and abs(found - mass) < 0.05


def test_what_an_arm_carries_while_it_is_learnt_counts_to_it():
    parts = blocks(moving_arm.rigid(22.0, 0))
    anew = learned([replace(part, loaded=True) for part in parts])  # after a payload that was taken for something else
    np.testing.assert_array_equal(anew.values, learned(parts).values)
    assert not anew.carries


@pytest.mark.long
def test_a_resumed_belief_weighs_a_payload_from_the_beginning():
    known = followed(moving_arm.rigid(LEARN, 0)).belief
    assert known is not None
    follower = followed(moving_arm.rigid(AFTER, 3, CARRYING), known)
    assert follower.belief is not None and list(follower.changes) == ["payload"]
    mass, sigma, _ = weighed(follower.belief)
    assert abs(mass - MASS) < 4.0 * sigma


@pytest.mark.long
def test_friction_that_may_have_changed_again_before_it_settled_is_compared_with_that_before_all_of_it():
    follower = ArmFollower(JOINTS, 30.0)
    first, again = object(), object()
    follower._open_friction(first, 10.0, 20.0)
    follower._open_friction(again, 13.0, 26.0)
    assert follower._opened == (first, 10.0, 26.0)  # and it settles from the last one


@pytest.mark.long
def test_another_friction_is_told():
    arm = moving_arm.rigid(LEARN + 3 * AFTER, 1)
    time = arm["bend"].time
    middle = moving_arm.at(time + 0.5 / RATE, 1).dq[:, 2]
    more = np.where(time > LEARN + AFTER, 0.3 * (VISCOUS[2] * middle + COULOMB[2] * np.sign(middle)), 0.0)
    follower = followed(with_torque(arm, {"bend": more}))
    assert follower.belief is not None and "bend" in follower.changes and "payload" not in follower.changes
    place = follower.belief.friction_of(2)[:2]
    np.testing.assert_allclose(follower.belief.values[place], [1.3 * VISCOUS[2], 1.3 * COULOMB[2]], rtol=0.03)
    assert follower.changes["bend"].since > LEARN + AFTER - 30.0


@pytest.mark.long
def test_friction_of_all_joints_that_rises_together_is_followed_and_told():
    """As of an arm that warms up: it was learnt anew."""
    arm = moving_arm.rigid(2 * LEARN, 2)
    time = arm["bend"].time
    middle = moving_arm.at(time + 0.5 / RATE, 2).dq
    more = 0.3 * (VISCOUS * middle + COULOMB * np.sign(middle)) * (time > LEARN)[:, None]
    follower = followed(with_torque(arm, {n: more[:, j] for j, n in enumerate(JOINTS)}))
    assert follower.belief is not None and not follower.unexplained and set(follower.changes) == set(JOINTS)
    places = follower.belief.friction.start + np.arange(2 * len(JOINTS))
    np.testing.assert_allclose(follower.belief.values[places], 1.3 * np.r_[VISCOUS, COULOMB], rtol=0.03)


@pytest.mark.long
def test_a_push_from_outside_is_no_payload_and_is_not_learnt():
    arm = moving_arm.rigid(LEARN + AFTER, 4)
    time = arm["lift"].time
    push = np.where((time > LEARN + 2.0) & (time < LEARN + 6.0), 30.0 * np.sin(9.0 * time), 0.0)
    follower, seen = ArmFollower(JOINTS, ARM.mass), set()
    for block in blocks(with_torque(arm, {"lift": push})):
        follower.add(block)
        seen |= set(follower.unexplained)
    assert "lift" in seen and follower.unexplained == ()
    assert follower.belief is not None and "payload" not in follower.changes
    assert np.abs(off(follower.belief)).max() < 5.0


@pytest.mark.long
def test_what_stays_unexplained_is_learnt_anew():
    arm = moving_arm.rigid(LEARN + 60.0, 5)
    time = arm["lift"].time
    spring = np.where(time > LEARN, 80.0 * arm["lift"]["link_position"], 0.0)  # no payload and no friction is one
    follower, lost = ArmFollower(JOINTS, ARM.mass), False
    for block in blocks(with_torque(arm, {"lift": spring})):
        follower.add(block)
        lost = lost or (float(block.time[-1]) > LEARN and follower.belief is None)
        assert follower.belief is not None or not follower.unexplained  # what is not known explains nothing
    assert lost and "payload" not in follower.changes


@pytest.mark.long
def test_a_rest_changes_nothing():
    arm = moving_arm.rigid(LEARN, 0)
    known = followed(arm).belief
    assert known is not None
    time = np.arange(round(20.0 * RATE)) / RATE
    rng = np.random.default_rng(0)
    still = {
        n: Recording(
            time,
            {
                "link_position": arm[n]["link_position"][-1] + 1e-5 * rng.standard_normal(len(time)),
                "torque": 5.0 * np.sin(0.3 * time) + 0.05 * rng.standard_normal(len(time)),
            },
            joint=n,
        )
        for n in JOINTS
    }
    follower = ArmFollower(JOINTS, ARM.mass, known)
    assert not any(follower.add(block) for block in blocks(still))
    assert follower.rests and follower.belief is known and follower.motion == known.duration


def test_a_joint_without_samples_is_named():
    arm, stream = moving_arm.rigid(6.0), ArmStream(REGRESSOR, GAINS, "arm.urdf")
    with pytest.raises(JointIdError, match=r"no samples of tilt, which arm\.urdf moves"):
        for batch in batches({n: r for n, r in arm.items() if n != "tilt"}):
            assert stream.push(batch) == []


def test_samples_out_of_order_are_refused_and_the_rest_is_used():
    arm, stream = moving_arm.rigid(3.0), ArmStream(REGRESSOR, GAINS, "arm.urdf")
    some = batches(arm)
    found = stream.push(some[0]) + stream.push(some[1])
    with pytest.raises(JointIdError, match=r"joint turn at 0\.1 s after those at"):
        stream.push(some[1])
    for batch in some[2:]:
        found += stream.push(batch)
    assert sum(len(part.time) for part in found) > 30 and all(part.used.any() for part in found)


def test_a_pause_costs_no_more_than_its_margins():
    arm = moving_arm.rigid(8.0)
    stream, found = ArmStream(REGRESSOR, GAINS, "arm.urdf"), []
    for batch in batches(arm):
        if not 3.0 <= batch["turn"].time[0] < 5.0:
            found += stream.push(batch)
    times = np.concatenate([part.time for part in found])
    assert not np.any((times > 3.0 - MARGIN_S + 0.5) & (times < 5.0 + MARGIN_S - 0.5)) and times[-1] > 7.0
    assert all(np.isfinite(part.columns[part.used]).all() for part in found)


def test_positions_that_jump_by_a_turn_are_the_same_motion():
    arm = moving_arm.rigid(4.0)
    turned = {n: r.with_channels({"link_position": r["link_position"] + 3.0}) for n, r in arm.items() if n == "turn"}
    wrapped = {
        n: r.with_channels({"link_position": np.angle(np.exp(1j * r["link_position"]))}) for n, r in turned.items()
    }
    assert np.abs(np.diff(wrapped["turn"]["link_position"])).max() > 6.0
    one, other = (blocks({**arm, **part}) for part in (turned, wrapped))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.used, b.used)
        np.testing.assert_allclose(a.columns[a.used], b.columns[b.used], atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("noise", first_quick([1e-5, 1e-4]))
def test_what_a_standing_joint_left_open_is_not_known_when_it_moves(noise):
    """It stood while the arm was learnt, and its neighbours' torques went together."""
    first = moving_arm.rigid(LEARN, 1, standing=("bend",), noise=noise)
    second = {
        n: Recording(r.time + LEARN + 5.0, r.channels, source=r.source, joint=n)
        for n, r in moving_arm.rigid(AFTER, 2).items()
    }
    stream = ArmStream(REGRESSOR, GAINS, "arm.urdf")
    follower = ArmFollower(JOINTS, ARM.mass, beforehand=Beforehand.of(REGRESSOR))
    for arm in (first, second):
        for batch in batches(arm):
            for block in stream.push(batch):
                follower.add(block)
        belief = follower.belief
        assert belief is not None
        for j in range(len(JOINTS)):
            truth = REGRESSOR.reference[j] + ROTOR[j]
            sigma = float(np.sqrt(belief.told_covariance[j, j]))
            assert not belief.seen[j] or abs(belief.values[j] - truth) < 4.0 * sigma, (
                JOINTS[j],
                belief.values[j],
                sigma,
            )
    assert not follower.changes  # no payload, and no other friction
