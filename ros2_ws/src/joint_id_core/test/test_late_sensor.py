"""A sensor that becomes late while the joint is watched: other parameters describe it well, and none is right."""

from __future__ import annotations

import functools
import re

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.results.estimate import Estimate
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick
from .readable import readable

MODEL = build("electromechanical")
SETTINGS = ParameterSettings(freed=("J_q",))
RATE, BEFORE_S, AFTER_S = 500, 8.0, 9.0
NOISE = {"current": 0.05, "link_position": 1e-5, "motor_velocity": 0.1}
BATCH = 50


@functools.cache
def motion():
    """Voltage and states of a joint that no controller drives."""
    time = np.arange(round((BEFORE_S + AFTER_S) * RATE)) / RATE
    voltage = multisine(time, 12.0, (0.25, 0.6, 1.1), seed=1)
    noise = 0.03 * np.random.default_rng(3).standard_normal(len(time))
    return time, voltage, simulate(MODEL, time, {"voltage": voltage + noise})


@functools.cache
def watched(late: float, seconds: float = AFTER_S) -> list[Estimate]:
    """Every estimate of it until `seconds` after `BEFORE_S`, when its link encoder becomes `late` samples late."""
    time, voltage, moved = motion()
    then = time - np.where(time >= BEFORE_S, late / RATE, 0.0)
    true = {**moved.channels, "link_position": np.interp(then, time, moved["link_position"])}
    rng = np.random.default_rng(4)
    seen = {n: true[n] + sigma * rng.standard_normal(len(time)) for n, sigma in NOISE.items()}
    recording = Recording(time, {**seen, "voltage": voltage})
    identifier = OnlineIdentifier(MODEL, SETTINGS)
    begins = range(0, round((BEFORE_S + seconds) * RATE), BATCH)
    found = (identifier.update(recording.slice(k, k + BATCH)) for k in begins)
    return [estimate for estimate in found if estimate is not None]


def after(late: float, seconds: float) -> list[Estimate]:
    """Those that came this long after the fault, and later."""
    return [e for e in watched(late) if e.end > BEFORE_S + seconds]


@pytest.mark.parametrize("seconds", first_quick([2.0, AFTER_S]))
def test_a_late_encoder_is_not_taken_for_another_joint(seconds):
    assert watched(2, seconds)[10].converged
    late = [e for e in watched(2, seconds) if e.end > BEFORE_S + 0.6]
    assert len(late) > seconds
    for estimate in late:
        assert not estimate.converged, f"{estimate.end - BEFORE_S} s after the fault: {estimate.message}"


@pytest.mark.long
@pytest.mark.parametrize(("late", "word"), [(2, "late"), (-3, "early")])
def test_the_sensor_and_its_delay_are_named(late, word):
    message = after(late, 8.0)[-1].message
    readable(message)
    found = re.search(f"link_position is {word} by (.+) ms", message)
    assert found, message
    assert float(found[1]) == pytest.approx(1e3 * abs(late) / RATE, rel=0.05)


@pytest.mark.long
def test_a_joint_without_a_fault_is_not_accused():
    assert all(e.converged and "check this sensor" not in e.message for e in after(0, 0.0))


@pytest.mark.long
def test_a_delay_of_less_than_a_sample_accuses_no_sensor():
    """A gear that is a little softer looks like that, and a sensor gets late by whole samples."""
    assert not any("check this sensor" in e.message for e in after(0.5, 0.0))
