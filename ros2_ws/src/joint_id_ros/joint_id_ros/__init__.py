"""ROS 2 nodes of joint_id: thin wrappers around `joint_id_core`."""

import os

# The matrices of a node are small: a second thread of BLAS waits for the first one, and doubles the processor time of
# an arm that is identified. NumPy reads this when it loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
