"""Identification of the dynamics of collaborative robot joints, without ROS."""
