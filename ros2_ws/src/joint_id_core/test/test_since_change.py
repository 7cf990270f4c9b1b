"""Stretches after a change of the joint: the filter found the state at their begin with the values before."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Array
from joint_id_core.estimators import Innovations, ParameterSettings
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online import returned as module
from joint_id_core.online.knowledge import Knowledge
from joint_id_core.online.learning import Explanation, learn
from joint_id_core.online.memory import Change
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.piece import Piece, Samples, State
from joint_id_core.online.returned import returned
from joint_id_core.online.task import Task
from joint_id_core.online.tracker import Tracker

from .loaded_joint import FACTOR, INERTIA, RATE, loaded, plant

WINDOW_S, LENGTH_S = 2.0, 0.5


@functools.cache
def known() -> Knowledge:
    joint = plant()
    settings = ParameterSettings({"k_t": joint.K_T})
    coordinates = Coordinates(joint.model, settings.applied_to(joint.model)[1])
    task = Task(joint.model, settings, OnlineOptions(window_s=WINDOW_S), Innovations(), coordinates)
    fit = task.fit(loaded(WINDOW_S), None)
    assert fit.converged
    made = Knowledge.from_window(task, fit, loaded(WINDOW_S))
    assert made.follower.tracker is not None
    made.follower.tracker.sharpen(0.0)
    return made


def tracker() -> Tracker:
    found = known().follower.tracker
    assert found is not None
    return found


def begins() -> list[int]:
    """First samples of stretches, among them those at which the joint turns back."""
    speed = loaded(WINDOW_S)["motor_velocity"]
    turns = np.flatnonzero(speed[1:] * speed[:-1] < 0.0)
    latest = len(speed) - round(LENGTH_S * RATE) - 1
    return sorted({*range(50, latest, 30), *(int(k) for k in turns if 50 <= k < latest)})


def stuck(begin: int, kept: Array) -> Piece:
    """A stretch at whose begin the filter is sure of a joint that stands still and is not where it is."""
    data, rows = tracker().data, slice(begin + 1, begin + 1 + round(LENGTH_S * RATE))
    samples = Samples(data.time[rows], data.u[rows], data.y[rows])
    state = State(kept, float(data.time[begin]), data.u[begin].copy())
    block = known().follower.memory.blocks[-1]
    return replace(block, begin=state, samples=samples, passed=None)


def standing(begin: int) -> Array:
    model, data = tracker().data.model, tracker().data
    kept = known().follower.memory.blocks[-1].begin.kept.copy()
    place = float(data.y[begin, data.labels.index("link_position")])
    there = {"link_position": place + 1e-3, "motor_position": (place + 7e-3) * known().last["N"].value}
    kept[:, 0] = [there.get(name, 0.0) for name in model.state_names]
    return kept


def mean_square(pieces: list[Piece]) -> Array:
    return np.array([float(np.nanmean(piece.white**2)) for piece in pieces])


def test_the_stretches_begin_at_their_labels_wherever_the_joint_turns_back():
    one = tracker()
    assert len(begins()) > 15
    for begin in begins():
        passed = one.again(one.since_change([stuck(begin, standing(begin))]), one.z.copy())
        assert passed is not None
        assert mean_square(passed[1]) < 1.35, f"from {begin / RATE} s"


def test_a_load_is_learned_from_such_a_stretch():
    """Where the filter held the joint, no change explained the samples, and the load was followed 8 s later."""
    one, memory = tracker(), known().follower.memory
    coordinates = one.coordinates
    true, free = one.z.copy(), list(known().last.free)
    j = free.index(INERTIA)
    before = true.copy()
    before[j] -= np.log(FACTOR)
    change = Change((j,), (), tuple(memory.blocks[-1:]), before, memory.covariance, 50.0)
    for begin in begins()[::4]:
        found = learn(one, [stuck(begin, standing(begin))], change, coordinates, one_cause=True)
        assert found is not None, f"from {begin / RATE} s"
        assert [free[k] for k in found.change.names] == [INERTIA]
        assert found.learned.z[j] == pytest.approx(true[j], abs=0.02)


def test_a_stretch_that_is_too_short_to_settle_is_left_out():
    one, whole = tracker(), stuck(100, standing(100))
    short, enough = (replace(whole, samples=whole.samples.split(count)[0]) for count in (35, 36))
    assert len(one.since_change([enough])[0].samples.time) == 10
    assert one.since_change([short]) == []
    kept = one.since_change([short, whole])
    assert len(kept) == 1 and kept[0].begin.start is not None
    assert one.since_change(kept)[0] is kept[0]


@functools.cache
def learned(length_s: float) -> tuple[list[Piece], Change, Explanation]:
    """A stretch with the joint as it is, the change that is found with a lighter one, and its new inertia."""
    one, memory = tracker(), known().follower.memory
    whole = stuck(100, standing(100))
    stretch = [replace(whole, samples=whole.samples.split(round(length_s * RATE))[0])]
    j = list(known().last.free).index(INERTIA)
    lighter = memory.mean.copy()
    lighter[j] -= np.log(FACTOR)
    newest = Change((j,), (), tuple(memory.blocks[-1:]), lighter, memory.covariance, 50.0)
    found = learn(one, stretch, newest, one.coordinates, one_cause=True)
    assert found is not None
    return stretch, newest, found


@pytest.mark.parametrize("heavier", [0.0, 3.0], ids=["the same", "a little heavier"])
def test_a_joint_that_is_as_it_was_is_known_again_and_its_load_is_learned_anew(heavier):
    """The next load may be a little heavier: that of the last time was believed, 6 standard deviations off for 6 s."""
    one, memory = tracker(), known().follower.memory
    stretch, newest, instead = learned(LENGTH_S)
    j = list(known().last.free).index(INERTIA)
    before = memory.mean - heavier * memory.covariance[j] / np.sqrt(memory.covariance[j, j])
    state = replace(newest, mean=before, covariance=memory.covariance)
    found = returned(one, stretch, state, newest, (), instead, one.coordinates)
    assert found is not None and found.undoes is not None
    assert found.change.likely == found.undoes.names == (j,)
    assert found.learned.z[j] == pytest.approx(memory.mean[j], abs=0.01)


def test_another_load_is_no_return():
    one, memory = tracker(), known().follower.memory
    stretch, newest, instead = learned(LENGTH_S)
    j = list(known().last.free).index(INERTIA)
    before = memory.mean.copy()
    before[j] -= 0.5 * np.log(FACTOR)
    assert returned(one, stretch, replace(newest, mean=before), newest, (), instead, one.coordinates) is None


def test_what_is_not_clearly_more_likely_is_no_return(monkeypatch):
    """As where samples hardly show the load: then any load explains them as well as the one before."""
    one, memory = tracker(), known().follower.memory
    stretch, newest, instead = learned(LENGTH_S)
    state = replace(newest, mean=memory.mean, covariance=memory.covariance)
    assert returned(one, stretch, state, newest, (), instead, one.coordinates) is not None
    monkeypatch.setattr(module, "CLEARLY", 50.0)
    assert returned(one, stretch, state, newest, (), instead, one.coordinates) is None
