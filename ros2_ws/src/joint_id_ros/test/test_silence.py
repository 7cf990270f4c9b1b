"""How long nothing has come, by clocks that stand or are set."""

import pytest

from joint_id_ros.silence import STEP_S, Silence


def test_a_clock_that_stands_or_is_set_adds_no_silence():
    now = [1000.0]
    silence = Silence(lambda: now[0])
    for _ in range(30):
        now[0] += 0.5 * STEP_S
        found = silence.look(came=False)
    assert found == pytest.approx(15.0 * STEP_S)
    assert [silence.look(came=False) for _ in range(100)] == [found] * 100  # a player that pauses
    now[0] -= 3600.0
    assert silence.look(came=False) == found
    now[0] += 7200.0  # set ahead, or this process did not run
    assert silence.look(came=False) == pytest.approx(found + STEP_S)
    assert silence.look(came=True) == 0.0
