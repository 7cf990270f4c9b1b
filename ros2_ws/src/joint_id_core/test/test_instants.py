"""Times that count from an origin keep every nanosecond."""

import math

from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.instants import instant, seconds


@given(st.integers(0, 86_400 * 10**9), st.integers(0, 2 * 10**18))
def test_seconds_since_an_origin_keep_every_nanosecond_of_a_day(offset, origin):
    assert instant(seconds(origin + offset, origin), origin) == origin + offset


def test_a_time_that_is_not_known_is_the_origin():
    assert instant(math.nan, 7) == 7
