"""What is given to a node beside the arguments of ROS: nothing but `--help`.

ROS leaves such words alone. A node would start all the same, with its defaults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import ModuleType

from joint_id_core.errors import JointIdError

BEGIN, END = "--ros-args", "--"  # of the arguments of ROS
USAGE = """usage: {name} [--ros-args -p PARAMETER:=VALUE ... -r NAME:=OTHER ...]

{about}

Parameters, topics and examples: docs/nodes/{name}.md. While it runs: ros2 param list, ros2 param describe."""


def beside_ros(words: Iterable[str]) -> list[str]:
    """Return the words that are not arguments of ROS."""
    found, of_ros = [], False
    for word in words:
        if word == BEGIN or (of_ros and word == END):
            of_ros = word == BEGIN
        elif not of_ros:
            found.append(word)
    return found


def helped(name: str, words: Iterable[str], module: Callable[[], ModuleType]) -> bool:
    """Print the help of a node if that is asked for, and return whether it was; `module` loads that of the node.

    Raises:
        JointIdError: any other word that is no argument of ROS.
    """
    own = beside_ros(words)
    if {"-h", "--help"} & {*own}:
        about = (module().__doc__ or "").splitlines()[0]
        print(USAGE.format(name=name, about=about.partition(": ")[2]))
        return True
    if own:
        raise JointIdError(
            f"{own[0]} is no argument of this node: parameters follow --ros-args, e.g. --ros-args -p NAME:=VALUE; "
            "--help says more"
        )
    return False
