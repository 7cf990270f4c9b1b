"""The ROS parameters of each node beside those that the library's own options become (`node_list`)."""
