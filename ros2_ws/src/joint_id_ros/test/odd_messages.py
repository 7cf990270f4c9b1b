"""Messages that no healthy publisher sends, made by hypothesis."""

import math

from builtin_interfaces.msg import Time
from hypothesis import strategies as st

from joint_id_core.formats.topics import Topic

NAMES = st.lists(st.sampled_from(["joint", "elbow", "", "a b", "\u00e4\u4e2d", "x" * 300]), max_size=4)
NUMBERS = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 1e-300, 0.0]) | st.floats(-10.0, 10.0)
STAMPS = st.builds(
    Time,
    sec=st.sampled_from([0, 1, -1, 100, 2**31 - 1, -(2**31)]) | st.integers(90, 110),
    nanosec=st.sampled_from([0, 1, 10**9 - 1, 10**9, 2**32 - 1]) | st.integers(0, 10**9),
)


@st.composite
def odd_messages(draw, topic: Topic, kind):
    """A message of a topic: names and arrays of any length, any number, any stamp."""
    message = kind(name=draw(NAMES))
    message.header.stamp = draw(STAMPS)
    lengths = st.sampled_from([0, len(message.name), len(message.name) + 1, 7])
    for field in topic.fields:
        length = draw(lengths)
        setattr(message, field, draw(st.lists(NUMBERS, min_size=length, max_size=length)))
    return message
