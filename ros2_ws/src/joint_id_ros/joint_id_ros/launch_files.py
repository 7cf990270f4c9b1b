"""Nodes and arguments of the launch files.

The arguments are the options of the nodes, so that name, default, choices and meaning are defined in one place. This
module does not need the package `launch`: documentation and tests use it, too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory

from joint_id_core.alignment.inputs import LINK_STATES
from joint_id_core.errors import JointIdError
from joint_id_core.simulation.plants import PositionControl
from joint_id_ros.options.node_list import NODES

Values = Mapping[str, str]  # text by name of the argument


@dataclass(frozen=True)
class Argument:
    """An argument of a launch file; with the default None it must be given."""

    name: str
    description: str
    default: str | None = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class NodeStart:
    """A node of this package to start.

    Attributes:
        name: name of the node and of its executable.
        own: parameters that the launch file sets.
        files: parameter files, which take precedence over `own`.
        given: parameters from the command line, which take precedence over the files.
        remappings: pairs of a topic of the node and the topic that replaces it.
    """

    name: str
    own: Mapping[str, object]
    files: list[str]
    given: Mapping[str, object]
    remappings: list[tuple[str, str]]

    # Several sections of parameter files may match a node. ROS orders them by their first appearance, and the last one
    # in this order wins. Parameter files mostly have sections for a node in any namespace (`/**/name`). `given_text`
    # uses the same section name, so it is a later text of the same section.

    @property
    def own_text(self) -> str:
        """Text of a parameter file with the parameters that the launch file sets."""
        return yaml.safe_dump({"/**": {"ros__parameters": dict(self.own)}})

    @property
    def given_text(self) -> str:
        """Text of a parameter file with the parameters from the command line."""
        return yaml.safe_dump({f"/**/{self.name}": {"ros__parameters": dict(self.given)}})


NAMESPACE = Argument("namespace", "namespace of all nodes, one a robot")
LOG_LEVEL = Argument("log_level", "what the nodes log", "info", ("debug", "info", "warn", "error", "fatal"))
RESPAWN = Argument("respawn", "start a node again, after a second, when it has ended", "false", ("true", "false"))


def _nothing(values: Values) -> dict[str, dict[str, object]]:
    return {}


def _no_topic(values: Values) -> dict[str, list[tuple[str, str]]]:
    return {}


@dataclass(frozen=True)
class LaunchFile:
    """One launch file.

    Attributes:
        summary: the nodes that it starts, in words.
        offers: by node, in the order of their start, the options that are arguments.
        required: arguments that must be given.
        more: arguments that are not options of a node.
        leader: node with whose end all others end, as soon as they have published everything; they are not started
            again then. Without one, the argument `respawn` says whether nodes that end are started again.
        own: returns, by node, the parameters that the launch file itself sets.
        remaps: returns, by node, pairs of a topic and the topic that replaces it.
    """

    summary: str
    offers: Mapping[str, tuple[str, ...]]
    required: tuple[str, ...] = ()
    more: tuple[Argument, ...] = ()
    leader: str = ""
    own: Callable[[Values], Mapping[str, Mapping[str, object]]] = field(default=_nothing)
    remaps: Callable[[Values], Mapping[str, list[tuple[str, str]]]] = field(default=_no_topic)

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """All arguments; an option that two nodes have is one argument for both."""
        made: dict[str, Argument] = {}
        for node, names in self.offers.items():
            for name in names:
                made.setdefault(name, _argument(_options(node)[name], name in self.required))
        params = Argument(
            "params_file",
            "parameter file: a path, or the name of one that is installed with this package, e.g. ur3e",
            None if "params_file" in self.required else "",
        )
        return (*made.values(), *self.more, params, NAMESPACE, LOG_LEVEL, *(() if self.leader else (RESPAWN,)))

    def starts(self, values: Values, given: Collection[str]) -> list[NodeStart]:
        """Return the nodes to start.

        Arguments that were `given` take precedence over the parameter file, and this over what the launch file sets.

        Raises:
            JointIdError: a text that is not a number where one is needed, or an unknown parameter file.
        """
        files = [parameter_file(values["params_file"])] if values["params_file"] else []
        own, remaps = self.own(values), self.remaps(values)
        return [
            NodeStart(
                node,
                own.get(node, {}),
                files,
                {name: _value(_options(node)[name], values[name]) for name in names if name in given},
                remaps.get(node, []),
            )
            for node, names in self.offers.items()
        ]


def parameter_file(text: str) -> str:
    """Return the path of a parameter file, given its path, or the name of an installed one with or without `.yaml`.

    Raises:
        JointIdError: no such file; the message lists the installed ones.
    """
    if Path(text).is_file():
        return text
    folder = Path(get_package_share_directory("joint_id_ros")) / "config"
    installed = {path.stem: path for path in sorted(folder.glob("*.yaml"))}
    if text.removesuffix(".yaml") not in installed:
        raise JointIdError(f"params_file {text}: no such file; installed are {', '.join(installed)}")
    return str(installed[text.removesuffix(".yaml")])


def _options(node: str) -> dict[str, Field[Any]]:
    return {f.name: f for options in NODES[node] for f in fields(options)}


def _all(node: str, *but: str) -> tuple[str, ...]:
    """Return all options of a node except `but`."""
    return tuple(name for name in _options(node) if name not in but)


def _argument(option: Field[Any], required: bool) -> Argument:
    meta, many = option.metadata, isinstance(option.default, tuple)
    unit = f" [{meta['unit']}]" if meta["unit"] else ""
    choices = ("true", "false") if isinstance(option.default, bool) else () if many else meta["choices"]
    description = meta["description"] + unit + ("; separated by commas" if many else "")
    return Argument(option.name, description, None if required else _text(option.default), choices)


def _text(value: object) -> str:
    """Return a default as the text that a user would type."""
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def _value(option: Field[Any], text: str) -> object:
    """Return the value of a ROS parameter from the text of an argument."""
    default = option.default
    parts = [part.strip() for part in text.split(",")]  # for ROS an empty list is a list with one empty text
    try:
        if isinstance(default, bool):
            return text == "true"
        if isinstance(default, int | float):
            return type(default)(text)
        if isinstance(default, tuple):
            return list(map(float, parts)) if default and isinstance(default[0], float) else parts
    except ValueError:
        raise JointIdError(f"{option.name}:={text}: write a number") from None
    return text


def _demo(values: Values) -> dict[str, dict[str, object]]:
    model: dict[str, object] = {"model": values["model"]}
    # The torque constant is known from the motor and cannot be identified from its motion.
    known = {"set": [f"k_t={PositionControl.K_T!r}"]} if values["model"] == PositionControl.MODEL else {}
    return {"sim": model | {"wait_subscribers": 1}, "identifier": model | known}


# The bag begins when its readers are ready, also those that compile first, and they end when it has ended.
REPLAY: dict[str, dict[str, object]] = {
    "player": {"wait_first_s": 600.0},
    "filter": {"use_sim_time": True, "recorded": True, "wait_subscribers": 1, "end_with": "player"},
    "identifier": {"use_sim_time": True, "recorded": True, "end_with": "filter"},
}


def _replayed(values: Values) -> dict[str, list[tuple[str, str]]]:
    """Return other topics of a replay; two bags that are replayed side by side have a time each."""
    clock = [("/clock", "clock")] if values[NAMESPACE.name] else []
    return {"player": clock, "filter": [(LINK_STATES, values[LINK_STATES]), *clock], "identifier": clock}


LOAD = ("description_topic", "urdf", "base_gravity")  # where no load is computed

LAUNCH_FILES = {
    "demo": LaunchFile(
        "a simulated joint, the filter and the identifier",
        offers={
            "filter": (),
            "sim": ("model", "rate", "duration", "seed", "noise"),
            "identifier": _all("identifier", "reliability", "recorded", "end_with", *LOAD),
        },
        own=_demo,
    ),
    "replay": LaunchFile(
        "a bag through filter and identifier",
        offers={
            "player": _all("player", "wait_first_s"),
            "identifier": _all(
                "identifier", "reliability", "recorded", "end_with"
            ),  # its samples come from our own filter
            "filter": _all("filter", "recorded", "wait_subscribers", "end_with"),
        },
        required=("bag",),
        leader="player",
        more=(Argument(LINK_STATES, "topic of the link states, e.g. joint_states", LINK_STATES),),
        own=lambda values: REPLAY,
        remaps=_replayed,
    ),
    "robot": LaunchFile(
        "driver, filter and identifier of one robot",
        offers={
            "driver": _all("driver", "joints", "gear_ratio"),  # not those of other nodes or per robot
            "filter": _all(
                "filter", "reliability", "recorded", "end_with"
            ),  # the samples of both come from our own nodes
            "identifier": _all("identifier", "reliability", "recorded", "end_with"),
        },
        required=("robot_ip", "params_file"),
    ),
    "arm": LaunchFile(
        "driver, filter and arm identifier of one robot",
        offers={
            "driver": _all("driver", "joints", "gear_ratio"),
            "filter": _all("filter", "reliability", "recorded", "end_with", *LOAD),
            "arm_identifier": _all("arm_identifier", "reliability", "end_with"),
        },
        required=("robot_ip", "params_file"),
    ),
    "fleet": LaunchFile(
        "the nodes of many robots, in one process or in some",
        offers={"fleet": ("robots", "processes")},
        required=("robots",),
    ),
}
