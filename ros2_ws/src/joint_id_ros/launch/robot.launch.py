"""Driver, filter and identifier of one robot: `ros2 launch joint_id_ros robot.launch.py robot_ip:=192.168.0.10 ...`."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from joint_id_core.rtde.fields import PORT

ARGUMENTS = [
    DeclareLaunchArgument("robot_ip", description="name or address of the robot"),
    DeclareLaunchArgument("port", default_value=str(PORT), description="port of the robot's RTDE server"),
    DeclareLaunchArgument(
        "params_file",
        description="parameter file with what is known of the robot: config/ur3e.yaml, ur5e.yaml, ur10e.yaml, your own",
    ),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of all nodes, one a robot"),
]


def nodes(context: LaunchContext) -> list[Node]:
    """The three nodes."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    own: dict[str, dict[str, object]] = {
        "filter": {},
        "identifier": {},
        "driver": {"robot_ip": given["robot_ip"], "port": int(given["port"])},
    }
    return [
        Node(
            package="joint_id_ros",
            executable=name,
            name=name,
            namespace=given["namespace"],
            output="screen",
            parameters=[parameters, given["params_file"]],
        )
        for name, parameters in own.items()
    ]


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
