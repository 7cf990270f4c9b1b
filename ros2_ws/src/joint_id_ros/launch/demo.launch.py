"""A simulated joint, the filter and the identifier: `ros2 launch joint_id_ros demo.launch.py`.

Watch the result with `ros2 topic echo /joint_params` and the truth with
`ros2 topic echo /truth --qos-durability transient_local`.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from joint_id_core.simulation.plants import PLANTS, PositionControl

ARGUMENTS = [
    DeclareLaunchArgument(
        "model",
        default_value="electromechanical",
        choices=list(PLANTS),
        description="what is simulated and identified: Model 3 under voltage steps, or Model 2 in position control",
    ),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of all nodes, one a robot"),
    DeclareLaunchArgument(
        "duration", default_value="0.0", description="time in s after which the simulation ends, 0: never"
    ),
    DeclareLaunchArgument("seed", default_value="0", description="seed of the sensor noise"),
    DeclareLaunchArgument(
        "params_file",
        default_value="",
        description="parameter file that overrides these arguments, e.g. from config/",
    ),
]


def nodes(context: LaunchContext) -> list[Node]:
    """The three nodes."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    sim = {
        "model": given["model"],
        "duration": float(given["duration"]),
        "seed": int(given["seed"]),
        "wait_subscribers": 1,
    }
    identifier: dict[str, object] = {"model": given["model"]}
    if given["model"] == PositionControl.MODEL:
        identifier["set"] = [f"k_t={PositionControl.K_T!r}"]  # known of a motor, and not identifiable from its motion
    file = [given["params_file"]] if given["params_file"] else []

    def node(name: str, parameters: dict[str, object]) -> Node:
        return Node(
            package="joint_id_ros",
            executable=name,
            name=name,
            namespace=given["namespace"],
            output="screen",
            parameters=[parameters, *file],
        )

    return [node("filter", {}), node("identifier", identifier), node("sim", sim)]


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
