"""What belongs to the recording may drift unseen: its interval is as wide as what two windows tell."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.estimators import Innovations
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.offsets import REACH, WINDOWS, Offsets

from .online_motion import MODEL, batches, motion

FREE = ("J", "c", "tau_f", "tau_0")


def test_after_a_minute_an_offset_is_known_as_two_windows_tell_it_and_the_joint_better():
    recording = motion(24.0)
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(window_s=2.0))
    last = [e for e in map(identifier.update, batches(recording)) if e is not None][-1]
    newest = Innovations().fit(MODEL, recording.window(recording.time[-1] - WINDOWS * 2.0, recording.time[-1]))
    assert last.converged
    assert 0.8 * REACH < last["tau_0"].std_dev / newest["tau_0"].std_dev < 1.2 * REACH
    assert last["J"].std_dev < 0.7 * newest["J"].std_dev
    assert np.linalg.eigvalsh(last.covariance).min() > 0.0


def blocks(*informations: float) -> SimpleNamespace:
    """A memory with blocks of half a second, the newest one last."""
    found = [SimpleNamespace(matrix=i * np.eye(len(FREE)), duration=0.5) for i in informations]
    return SimpleNamespace(blocks=found, newest=found[-1] if found else None)


def test_only_the_newest_samples_count():
    offsets, covariance = Offsets(MODEL, FREE, np.full(len(FREE), 100.0), 1.0), 1e-6 * np.eye(len(FREE))
    wider = offsets.widened(covariance, blocks(1e9, 1e9, 4.0, 4.0, 4.0, 4.0))
    assert wider[3, 3] == pytest.approx(REACH**2 / 16.0, rel=1e-3)
    np.testing.assert_array_equal(wider[:3], covariance[:3])


def test_after_a_restart_half_a_second_stands_for_the_rest():
    """Else what was known would be forgotten."""
    offsets, covariance = Offsets(MODEL, FREE, np.full(len(FREE), 100.0), 1.0), 1e-6 * np.eye(len(FREE))
    assert offsets.widened(covariance, blocks(4.0))[3, 3] == pytest.approx(REACH**2 / 16.0, rel=1e-3)
    assert offsets.widened(covariance, blocks()) is covariance


def test_an_interval_that_is_wider_already_stays():
    offsets, covariance = Offsets(MODEL, FREE, np.full(len(FREE), 100.0), 1.0), np.eye(len(FREE))
    np.testing.assert_array_equal(offsets.widened(covariance, blocks(4.0, 4.0, 4.0, 4.0)), covariance)


def test_models_without_offsets_are_as_they_were():
    covariance = np.eye(2)
    assert Offsets(build("dc_motor"), ("R", "k_b"), np.ones(2), 1.0).widened(covariance, blocks(4.0)) is covariance


def test_another_newest_block_counts_at_once():
    offsets, covariance = Offsets(MODEL, FREE, np.full(len(FREE), 100.0), 1.0), 1e-6 * np.eye(len(FREE))
    offsets.widened(covariance, blocks(4.0, 4.0, 4.0, 4.0))
    assert offsets.widened(covariance, blocks(9.0, 9.0, 9.0, 9.0))[3, 3] == pytest.approx(REACH**2 / 36.0, rel=1e-3)
