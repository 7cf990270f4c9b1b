"""Driver, filter and arm identifier of one robot.

`ros2 launch joint_id_ros arm.launch.py robot_ip:=192.168.0.10 params_file:=ur10e`
"""

from launch import LaunchDescription

from joint_id_ros.launching import description


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes: see `joint_id_ros.launch_files`."""
    return description("arm")
