"""Stamps of simulated hours: near the true instants, with the steps of the controller, whatever the network does."""

import re
import time

import numpy as np
import pytest

from joint_id_core.rtde.clock import ControllerClock

from .quick import first_quick

RATE = 500.0
SMALLEST_S = 150e-6  # delay of the network at its best
SCATTER_S = 200e-6  # mean of the exponential delay on top
SLEW = 200e-6
# The offset rests where arrivals below it, by which it falls, balance its rise: for exponential delays near
# sqrt(2 * scatter * rise in a period), 13 us here. Scatters of several times that are the worst of an hour.
NEAR_S = 100e-6
EPOCH_NS = 1_700_000_000_000_000_000


class Stamps:
    """What a clock says of samples taken at true instants and arriving after delays.

    Args:
        taken_s: true instants at which samples were taken, s after the epoch; also what a system clock says that is
            never set or slewed.
        controller_s: the controller's clock at these instants.
        delay_s: of the network; packets do not overtake each other.
        system_s: system clock at the arrivals minus the true time.
        set_s: of that, what came by setting the clock.
    """

    def __init__(self, taken_s, controller_s, delay_s, system_s=0.0, set_s=0.0):
        arrived_s = np.maximum.accumulate(taken_s + delay_s)
        self.taken_s, self.controller_s = taken_s, controller_s
        received = EPOCH_NS + np.round((arrived_s + system_s) * 1e9).astype(np.int64)
        ahead = np.round(np.broadcast_to(set_s, taken_s.shape) * 1e9).astype(np.int64).tolist()
        self.events, self.ahead_ns = [], ahead[0]
        clock = ControllerClock(lambda *event: self.events.append(event), lambda: self.ahead_ns)
        stamps = []
        for controller, at, self.ahead_ns in zip(controller_s.tolist(), received.tolist(), ahead, strict=True):
            stamps.append(clock.stamp(controller, at))
        self.stamps = np.array(stamps)

    @property
    def error_s(self):
        """Stamps minus true instants."""
        return (self.stamps - EPOCH_NS) * 1e-9 - self.taken_s

    def steps(self):
        """Relative difference of the steps of the stamps from those of the controller's clock."""
        return np.diff(self.stamps) * 1e-9 / np.diff(self.controller_s) - 1.0


def assert_steady(stamps, first=0, last=None):
    """Strictly increasing, with the controller's steps to 200 ppm and the rounding to ns."""
    assert (np.diff(stamps.stamps[first:last]) > 0).all()
    rounding = 1e-9 / np.diff(stamps.controller_s[first:last]).min() + 1e-7
    assert np.abs(stamps.steps()[first : None if last is None else last - 1]).max() <= SLEW + rounding


def instants(seconds, rate=RATE):
    return np.arange(round(seconds * rate)) / rate


def delays(count, seed=0, scatter=SCATTER_S):
    delay = SMALLEST_S + np.random.default_rng(seed).exponential(scatter, count)
    delay[0] = SMALLEST_S  # the first sample is believed
    return delay


@pytest.mark.parametrize("crystal", first_quick([-50e-6, 0.0, 50e-6]))
def test_a_quarter_of_an_hour_at_500_hz(crystal):
    t = instants(900.0)
    s = Stamps(t, 1234.5 + t * (1.0 + crystal), delays(len(t)))
    assert_steady(s)
    assert s.error_s.min() >= SMALLEST_S - 1e-8
    assert s.error_s.max() <= SMALLEST_S + NEAR_S
    assert s.events == []


@pytest.mark.parametrize("crystal", first_quick([-50e-6, 50e-6]))
def test_six_hours(crystal):
    """At 10 Hz, where the offset may rise 50 times as far in a period, and with it what it rests at by sqrt(50)."""
    t = instants(6.0 * 3600.0, rate=10.0)
    s = Stamps(t, t * (1.0 + crystal), delays(len(t)))
    assert_steady(s)
    assert s.error_s.min() >= SMALLEST_S - 1e-8
    assert s.error_s.max() <= SMALLEST_S + 7.0 * NEAR_S
    assert s.events == []


def test_a_late_first_sample_is_made_good_by_200_ppm():
    t = instants(120.0)
    delay = delays(len(t))
    delay[0] = 0.010
    s = Stamps(t, t, delay)
    assert_steady(s)
    late = s.error_s - SMALLEST_S
    assert late[0] == pytest.approx(0.010 - SMALLEST_S, abs=1e-8)
    assert (late <= np.maximum(0.010 - SLEW * t, 0.0) + NEAR_S).all()


def test_stalls_and_the_bursts_after_them_move_nothing():
    t = instants(300.0)
    delay = delays(len(t))
    stalls = [(50.0, 2.0), (100.0, 0.5), (103.0, 0.5), (200.0, 5.0)]
    for start, length in stalls:  # nothing arrives until its end
        held = (t >= start) & (t < start + length)
        delay[held] += start + length - t[held]
    s = Stamps(t, t, delay)
    assert_steady(s)
    assert s.events == []
    # Without a prompt packet the offset rises for as long as the stall is, and falls as fast afterwards.
    unsure = np.zeros(len(t))
    for start, length in stalls:
        unsure += SLEW * np.clip(np.where(t < start + length, t - start, start + 2.0 * length - t), 0.0, None)
    assert s.error_s.min() >= SMALLEST_S - 1e-8
    assert (s.error_s <= SMALLEST_S + NEAR_S + unsure).all()


def test_lost_samples_move_nothing():
    t = instants(200.0)[np.random.default_rng(3).random(100_000) > 0.05]
    s = Stamps(t, t * (1.0 + 50e-6), delays(len(t)))
    assert_steady(s)
    assert s.error_s.min() >= SMALLEST_S - 1e-8 and s.error_s.max() <= SMALLEST_S + NEAR_S
    assert s.events == []


@pytest.mark.parametrize("crystal", [-50e-6, 50e-6])
def test_after_an_hour_without_samples_the_first_one_is_believed(crystal):
    t = instants(20.0)
    t[5000:] += 3600.0
    s = Stamps(t, t * (1.0 + crystal), delays(len(t)))
    assert s.events == []
    late = s.error_s[5000:] - SMALLEST_S
    assert late.min() >= -1e-8
    assert late[0] <= 0.005 and late[2000:].max() <= NEAR_S
    assert_steady(s, 0, 5000)
    assert_steady(s, 5000)


@pytest.mark.parametrize("slew", first_quick([-100e-6, 100e-6]))
def test_a_system_clock_that_is_slewed_is_followed(slew):
    """Corrected by 100 ppm for three minutes: true are the instants on that clock."""
    t = instants(600.0)
    system = np.interp(t, [120.0, 300.0], [0.0, 180.0 * slew])
    s = Stamps(t, t * (1.0 + 20e-6), delays(len(t)), system)
    assert_steady(s)
    assert s.events == []
    late = s.error_s - system - SMALLEST_S
    assert np.abs(late).max() <= 1.2 * NEAR_S


def test_a_system_clock_that_is_slewed_too_fast_is_followed_late():
    """By 500 ppm for a minute: 200 of them are followed at once, 300 afterwards."""
    t = instants(300.0)
    system = np.interp(t, [60.0, 120.0], [0.0, -60.0 * 500e-6])
    s = Stamps(t, t, delays(len(t)), system)
    assert_steady(s)
    assert s.events == []
    late = s.error_s - system - SMALLEST_S
    assert 0.015 < late.max() <= 60.0 * 300e-6 + NEAR_S
    assert late[t > 120.0 + 60.0 * 300e-6 / SLEW].max() <= NEAR_S


@pytest.mark.parametrize("step_s", [3600.0, 0.2, -0.005, -7.5])
def test_a_system_clock_that_is_set_takes_the_stamps_with_it_at_once(step_s):
    t = instants(60.0)
    at = 15_000
    system = np.where(np.arange(len(t)) >= at, step_s, 0.0)
    s = Stamps(t, t, delays(len(t)), system, system)
    assert_steady(s, 0, at)
    assert_steady(s, at)
    late = s.error_s - system - SMALLEST_S
    assert late.min() >= -1e-8 and late.max() <= NEAR_S
    assert s.events == [("clock set", f"the system's clock was set by {step_s:+.3f} s, and stamps with it")]


@pytest.mark.parametrize("step_s", [30.0, -30.0])
def test_a_system_clock_that_is_set_between_an_arrival_and_its_stamp(step_s):
    """The arrivals of that moment are still on the old clock: nothing is learnt from them."""
    t = instants(60.0)
    index = np.arange(len(t))
    system = np.where(index >= 15_001, step_s, 0.0)
    known = np.where(index >= 15_000, step_s, 0.0)
    s = Stamps(t, t, delays(len(t)), system, known)
    late = s.error_s - known - SMALLEST_S
    assert late.min() >= -1e-8 and late.max() <= NEAR_S
    assert len(s.events) == 1


def test_a_thread_held_up_between_two_readings_is_no_clock_that_was_set():
    readings = iter([0, -5_000_000, 0, 0, 0])
    clock = ControllerClock(lambda *event: pytest.fail(f"{event}"), lambda: next(readings))
    assert clock.stamp(1.0, EPOCH_NS) == EPOCH_NS
    assert clock.stamp(1.002, EPOCH_NS + 2_000_000) == EPOCH_NS + 2_000_000


@pytest.mark.parametrize("step_s", [-1000.0, -0.010, 0.2, 86400.0])
def test_a_controller_clock_that_jumps_is_told_once_and_stamps_go_on(step_s):
    t = instants(60.0)
    at = 15_000
    delay = delays(len(t))
    s = Stamps(t, 2000.0 + t + np.where(np.arange(len(t)) >= at, step_s, 0.0), delay)
    assert len(s.events) == 1
    kind, text = s.events[0]
    change = re.fullmatch(r"the controller's clock (.*): its offset to the system's clock changes by (.*) s", text)
    assert change[1] == ("went back" if step_s < 0.0 else "ran ahead of the arrival of its samples")
    assert -float(change[2]) == pytest.approx(step_s, abs=0.001 + delay[at])
    assert kind == "clock set"
    assert (np.diff(s.stamps) > 0).all()
    late = s.error_s - SMALLEST_S
    assert late.min() >= -1e-8
    assert late.max() <= max(NEAR_S, delay[at])
    assert_steady(s, 0, at)
    assert_steady(s, at)


def test_a_small_jump_of_the_controller_clock_is_made_good_by_200_ppm():
    t = instants(400.0)
    s = Stamps(t, t + np.where(t >= 30.0, 0.05, 0.0), delays(len(t)))
    assert s.events == []
    assert (np.diff(s.stamps) > 0).all()
    late = s.error_s - SMALLEST_S
    assert np.abs(late[t < 30.0]).max() <= NEAR_S
    assert late[15_000] == pytest.approx(0.05, abs=NEAR_S)
    assert np.abs(late[t > 30.0 + 0.05 / SLEW]).max() <= NEAR_S


def test_stamps_that_are_ahead_of_arrivals_by_too_much_wait_for_them():
    """Two jumps that are too small to be seen, together are not: 25 samples or so wait, the rest goes on in steps."""
    t = instants(100.0)
    s = Stamps(t, t + np.where(t >= 30.0, 0.09, 0.0) + np.where(t >= 31.0, 0.05, 0.0), delays(len(t)))
    steps = np.diff(s.stamps)
    assert (steps > 0).all()
    waiting = steps < 1_000_000
    assert 0 < waiting.sum() < 30 and (steps[~waiting] > 1_999_000).all()
    assert np.abs(s.error_s[t > 31.1]).max() < 0.1 + NEAR_S


def test_a_robot_that_was_restarted_is_taken_anew_when_told():
    """Without being told, its clock, further on than before, would seem to be late."""
    t = instants(40.0)
    clock = ControllerClock(lambda *event: pytest.fail(f"{event}"), lambda: 0)
    stamps = [clock.stamp(5.0 + i, round((100.0 + i) * 1e9)) for i in t.tolist()]
    clock.forget()
    stamps += [clock.stamp(50.0 + i, round((300.0 + i) * 1e9)) for i in t.tolist()]
    assert stamps == np.round(np.concatenate([100.0 + t, 300.0 + t]) * 1e9).tolist()


def test_a_controller_clock_that_stood_still_is_noticed_after_ten_seconds():
    """Nothing but the arrivals says so; until then it might be the network."""
    t = instants(60.0)
    t = t[(t < 30.0) | (t >= 30.3)]
    s = Stamps(t, np.where(t < 30.0, t, t - 0.3), delays(len(t)))
    late = s.error_s - SMALLEST_S
    assert np.abs(late[t < 30.0]).max() <= NEAR_S
    assert np.abs(late[t > 40.4]).max() <= NEAR_S
    why = "the controller's clock stood still, or this computer cannot keep up"
    assert s.events == [("clock set", f"{why}: its offset to the system's clock changes by +0.298 s")]
    assert (np.diff(s.stamps) > 0).all()


def test_repeated_times_still_give_increasing_stamps():
    clock = ControllerClock(system_ahead_ns=lambda: 0)
    stamps = [clock.stamp(t, EPOCH_NS + round(t * 1e9)) for t in (1.0, 1.002, 1.002, 1.002, 1.004)]
    assert stamps == [EPOCH_NS + n for n in (1_000_000_000, 1_002_000_000, 1_002_000_001, 1_002_000_002, 1_004_000_000)]


def test_the_clocks_of_this_machine():
    """With the real clocks, a sample that has just come is stamped now."""
    clock = ControllerClock(lambda *event: pytest.fail(f"{event}"))
    for k in range(100):
        now = time.time_ns()
        assert abs(clock.stamp(now * 1e-9, now) - now) < 1000, k
