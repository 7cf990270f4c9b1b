"""ROS 2 nodes of joint_id: thin wrappers around `joint_id_core`."""
