"""Driver, filter and identifier of many robots: `ros2 launch joint_id_ros fleet.launch.py robots:=robots.yaml`."""

from launch import LaunchDescription

from joint_id_ros.launching import description


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes: see `joint_id_ros.launch_files`."""
    return description("fleet")
