"""ROS parameters of each node, in addition to those from the library's own options (`node_list`)."""
