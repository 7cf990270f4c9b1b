"""Build launch descriptions from `launch_files`. Needs `launch` and `launch_ros`."""

from __future__ import annotations

import tempfile

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from joint_id_ros.launch_files import LAUNCH_FILES, Argument


def description(name: str) -> LaunchDescription:
    """Return arguments and nodes of the launch file `<name>.launch.py`."""
    launch_file = LAUNCH_FILES[name]
    given: set[str] = set()

    def note_given(context: LaunchContext) -> None:
        """Remember which arguments were given, before defaults are applied."""
        given.update(context.launch_configurations)

    def nodes(context: LaunchContext) -> list[Node]:
        values = {a.name: context.launch_configurations[a.name] for a in launch_file.arguments}
        return [
            Node(
                package="joint_id_ros",
                executable=start.name,
                name=start.name,
                namespace=values["namespace"],
                output="screen",
                parameters=[_saved(start.own_text), *start.files, _saved(start.given_text)],
                remappings=start.remappings,
            )
            for start in launch_file.starts(values, given)
        ]

    declared = map(_declare, launch_file.arguments)
    return LaunchDescription([OpaqueFunction(function=note_given), *declared, OpaqueFunction(function=nodes)])


def _saved(text: str) -> str:
    """Save a parameter file with this text and return its path."""
    with tempfile.NamedTemporaryFile("w", prefix="joint_id_", suffix=".yaml", delete=False) as file:
        file.write(text)
    return file.name


def _declare(argument: Argument) -> DeclareLaunchArgument:
    return DeclareLaunchArgument(
        argument.name,
        default_value=argument.default,
        description=argument.description,
        choices=list(argument.choices) or None,
    )
