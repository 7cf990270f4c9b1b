"""A bag through filter and identifier: `ros2 launch joint_id_ros replay.launch.py bag:=recordings/run1 ...`."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from joint_id_core.alignment.inputs import EFFORTS, LINK_STATES, VELOCITIES, InputOptions
from joint_id_core.estimators import ESTIMATORS
from joint_id_core.models import LAWS, MODELS

DEFAULTS = InputOptions()
ARGUMENTS = [
    DeclareLaunchArgument("bag", description="bag to play: a directory, or a bare .mcap or .db3 file"),
    DeclareLaunchArgument("topics", default_value="", description="topics to play, comma separated; empty: all"),
    DeclareLaunchArgument("rate", default_value="1.0", description="speed; 0: as fast as the nodes keep up"),
    DeclareLaunchArgument(
        "model", default_value="electromechanical", choices=list(MODELS), description="joint model to identify"
    ),
    DeclareLaunchArgument("joints", default_value="", description="joints to identify, comma separated; empty: all"),
    DeclareLaunchArgument("set", default_value="", description="start and fixed values, e.g. N=101,k_t=0.1"),
    DeclareLaunchArgument("fix", default_value="", description="parameters to hold, e.g. tau_fq=0,c_1"),
    DeclareLaunchArgument("friction", default_value=LAWS[0], choices=list(LAWS), description="friction law"),
    DeclareLaunchArgument("gravity", default_value="false", choices=["true", "false"], description="model gravity"),
    DeclareLaunchArgument(
        "estimator", default_value=ESTIMATORS[0], choices=list(ESTIMATORS), description="estimation method"
    ),
    DeclareLaunchArgument(
        "link_states", default_value=LINK_STATES, description="topic of the link states, e.g. joint_states"
    ),
    DeclareLaunchArgument(
        "effort_source",
        default_value=DEFAULTS.effort_source,
        choices=["", *EFFORTS],
        description="what the effort in the link states is; needed for a topic that is not called link_states",
    ),
    DeclareLaunchArgument(
        "velocity_source",
        default_value=DEFAULTS.velocity_source,
        choices=list(VELOCITIES),
        description="what the velocity in the link states is",
    ),
    DeclareLaunchArgument(
        "gear_ratio",
        default_value=str(DEFAULTS.gear_ratio),
        description="gear ratio, for an effort that is a torque and for a velocity that is motor_over_gear_ratio",
    ),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of all nodes, one a robot"),
    DeclareLaunchArgument(
        "params_file",
        default_value="",
        description="parameter file that overrides these arguments, e.g. from config/",
    ),
]


def nodes(context: LaunchContext) -> list[Node]:
    """Filter and identifier on the clock of the bag, and the player."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}

    def texts(name: str) -> list[str]:
        return [text.strip() for text in given[name].split(",")]  # an empty list is one empty text to ROS

    effort = given["effort_source"]
    parameters: dict[str, dict[str, object]] = {
        "filter": {
            "effort_source": effort,
            "velocity_source": given["velocity_source"],
            "gear_ratio": float(given["gear_ratio"]),
            "use_sim_time": True,
        },
        "identifier": {
            "model": given["model"],
            "joints": texts("joints"),
            "set": texts("set"),
            "fix": texts("fix"),
            "friction": given["friction"],
            "gravity": given["gravity"] == "true",
            "estimator": given["estimator"],
            "actuation": "current" if effort in ("", "current") else "torque",
            "use_sim_time": True,
        },
        "player": {"bag": given["bag"], "topics": texts("topics"), "rate": float(given["rate"])},
    }
    file = [given["params_file"]] if given["params_file"] else []
    remaps = {"filter": [(LINK_STATES, given[LINK_STATES])]}
    return [
        Node(
            package="joint_id_ros",
            executable=name,
            name=name,
            namespace=given["namespace"],
            output="screen",
            parameters=[own, *file],
            remappings=remaps.get(name, []),
        )
        for name, own in parameters.items()
    ]


def generate_launch_description() -> LaunchDescription:
    """Arguments and nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
