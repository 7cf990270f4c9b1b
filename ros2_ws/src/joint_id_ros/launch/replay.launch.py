"""A bag through filter and identifier: `ros2 launch joint_id_ros replay.launch.py bag:=recordings/run1 ...`."""

from launch import LaunchDescription

from joint_id_ros.launching import description


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes: see `joint_id_ros.launch_files`."""
    return description("replay")
