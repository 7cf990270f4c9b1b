"""Build launch descriptions from `launch_files`. Needs `launch` and `launch_ros`."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping

from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events.process import ProcessExited
from launch_ros.actions import Node

from joint_id_ros.launch_files import LAUNCH_FILES, Argument, NodeStart
from joint_id_ros.running import ENDED_EARLY

RESPAWN_DELAY_S = 1.0


def description(name: str) -> LaunchDescription:
    """Return arguments and nodes of the launch file `<name>.launch.py`."""
    launch_file = LAUNCH_FILES[name]
    given: set[str] = set()

    def note_given(context: LaunchContext) -> None:
        """Remember which arguments were given, before defaults are applied."""
        given.update(context.launch_configurations)

    def nodes(context: LaunchContext) -> list[Action]:
        values = {a.name: context.launch_configurations[a.name] for a in launch_file.arguments}
        made = {start.name: _node(start, values) for start in launch_file.starts(values, given)}
        watches = _ends(made, launch_file.leader) if launch_file.leader else []
        return [*watches, *made.values()]

    declared = map(_declare, launch_file.arguments)
    return LaunchDescription([OpaqueFunction(function=note_given), *declared, OpaqueFunction(function=nodes)])


def _node(start: NodeStart, values: Mapping[str, str]) -> Node:
    return Node(
        package="joint_id_ros",
        executable=start.name,
        name=start.name,
        namespace=values["namespace"],
        output="screen",
        parameters=[_saved(start.own_text), *start.files, _saved(start.given_text)],
        remappings=start.remappings,
        ros_arguments=["--log-level", values["log_level"]],
        respawn=values.get("respawn") == "true",
        respawn_delay=RESPAWN_DELAY_S,
    )


def _ends(nodes: Mapping[str, Node], leader: str) -> list[Action]:
    """Return handlers that end the launch when a node has failed, so that its exit code tells.

    If the leader fails after a part of its input, the others publish what they have, and end by themselves.
    """
    codes: dict[str, int] = {}

    def note(event: ProcessExited, context: LaunchContext) -> None:
        name = next(name for name, node in nodes.items() if node is event.action)
        codes[name] = event.returncode
        wrong = {n: code for n, code in codes.items() if code}
        early = wrong == {leader: ENDED_EARLY} and len(codes) < len(nodes)
        if wrong and not early and not context.is_shutdown:
            failed, code = next(iter(wrong.items()))
            raise RuntimeError(f"{failed} has ended with exit code {code}: its last line says why")

    return [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=note)) for node in nodes.values()]


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
