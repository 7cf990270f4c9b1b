"""A simulated joint, the filter and the identifier: `ros2 launch joint_id_ros demo.launch.py`.

Watch the result with `ros2 topic echo /joint_params` and the truth with
`ros2 topic echo /truth --qos-durability transient_local --qos-reliability reliable`.
"""

from launch import LaunchDescription

from joint_id_ros.launching import description


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes: see `joint_id_ros.launch_files`."""
    return description("demo")
