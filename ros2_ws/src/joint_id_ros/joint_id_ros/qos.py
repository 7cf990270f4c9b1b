"""Quality of service of the topics.

Streams of samples are reliable. Best effort would drop samples whenever a reader is busy for a moment, and every lost
sample is a gap in the identification window. A reader of foreign publishers may be told to take best effort too, which
matches every publisher. Subscribers keep all messages until they are read (the middleware limits
them to some thousand samples). Live sources keep the last `DEPTH` samples for late readers, so that a slow reader never
blocks a robot. The player keeps all messages and waits for slow readers.
"""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

DEPTH = 2000  # 4 s at 500 Hz: longer than any pause of a healthy reader

STREAM_IN = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
STREAM_OUT = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
REPLAY = STREAM_IN
LOSSY_IN = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.BEST_EFFORT)
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Reliable, so that the last message arrives. The clocks of nodes subscribe with best effort and depth 1. This is
# compatible, and a busy node then gets only the newest message.
CLOCK = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
FLUSH = Duration(seconds=1)  # longest wait until readers have received the last samples
