"""Quality of service of the topics.

Streams of samples are reliable: best effort drops samples whenever a reader is busy for a moment, and
every lost sample is a gap in the identification window. Subscribers keep all that has arrived until it
is read (the middleware bounds it at some thousand samples). Live sources keep the last `DEPTH` samples
for readers that are late, so that a slow reader never holds up a robot; the player keeps all, so that it
waits for slow readers instead.
"""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

DEPTH = 2000  # 4 s at 500 Hz: longer than any pause of a healthy reader

STREAM_IN = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
STREAM_OUT = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
REPLAY = STREAM_IN
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Reliable, so that the last one arrives. The clocks of nodes subscribe with best effort and depth 1, which fits: a busy
# node then skips to the newest.
CLOCK = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
FLUSH = Duration(seconds=1)  # longest wait for readers to have taken the last samples
