"""Commands that the emulator takes while it runs: faults, what the robot carries, and how it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

from joint_id_core.errors import JointIdError


@dataclass(frozen=True)
class Command:
    """A command: name, meaning, kind of argument, default of the argument.

    `argument` is "" (none), "N" (a count), "S" (seconds, not negative), "+-S" (seconds), "KG" (a mass above 0), "FILE"
    (all that follows) or "on|off". With the default NaN the argument must be given.
    """

    name: str
    meaning: str
    argument: str = ""
    default: float = math.nan


COMMANDS: dict[str, Command] = {
    c.name: c
    for c in (
        Command("drop", "the next N samples are not sent", "N", 1),
        Command("stall", "nothing is sent for S s, the connections stay", "S", 2.0),
        Command("kill", "all connections are cut"),
        Command("power-cycle", "all is cut, no connection for S s, then back with the clock at zero", "S", 3.0),
        Command("power-off", "motors off, brakes on: robot and joint modes POWER_OFF, current zero"),
        Command("power-on", "brakes off, motors on: the joints go on from where they are"),
        Command("protective-stop", "safety mode PROTECTIVE_STOP, the joints stop and hold"),
        Command("unlock", "end of the protective stop: the joints go on"),
        Command("pick-up", "with --urdf: the last link carries KG kg from now on", "KG"),
        Command("put-down", "with --urdf: the last link carries nothing from now on"),
        Command(
            "follow",
            "the joints come to rest, go to the start of a trajectory (CSV or YAML), follow it and stay",
            "FILE",
        ),
        Command("stop", "the joints come to rest and stay there, until follow or power-cycle"),
        Command("zero", "every value of the next N samples is zero", "N", 1),
        Command("nan", "actual_q of the next N samples is NaN", "N", 1),
        Command("clock-jump", "the controller's clock jumps by S s", "+-S"),
        Command("garbage", "N random bytes in the stream", "N", 64),
        Command("fragment", "packets are split and glued at random", "on|off"),
        Command("quit", "the emulator ends"),
    )
}
_LARGEST_COUNT, _LARGEST = 1_000_000, 1e6


def parse(line: str) -> tuple[str, float | str]:
    """Return name and argument of a command line; the argument is NaN if the command has none, 1 for on, 0 for off.

    Raises:
        JointIdError: unknown command, missing argument, too many arguments, or an argument out of range.
    """
    name, *arguments = line.split()
    if name not in COMMANDS:
        raise JointIdError(f"unknown command {name!r}: the commands are {', '.join(COMMANDS)}")
    command = COMMANDS[name]
    if command.argument == "FILE" and arguments:
        return name, line.split(maxsplit=1)[1].strip()
    if len(arguments) > (1 if command.argument else 0):
        raise JointIdError(f"command {line.strip()!r}: write {usage(command)}")
    if not arguments:
        if command.argument and math.isnan(command.default):
            raise JointIdError(f"command {name} needs an argument: write {usage(command)}")
        return name, command.default
    return name, _argument(command, arguments[0])


def usage(command: Command) -> str:
    """Return the syntax of a command, e.g. `drop [N=1]`."""
    if not command.argument:
        return command.name
    given = command.argument if math.isnan(command.default) else f"[{command.argument}={command.default:g}]"
    return f"{command.name} {given}"


def _argument(command: Command, text: str) -> float:
    if command.argument == "on|off":
        if text in ("on", "off"):
            return float(text == "on")
    else:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        whole = command.argument != "N" or (value.is_integer() and 1 <= value <= _LARGEST_COUNT)
        signed = value > 0.0 if command.argument == "KG" else value >= 0.0 or command.argument == "+-S"
        if whole and signed and abs(value) <= _LARGEST:
            return value
    raise JointIdError(f"command {command.name} {text}: write {usage(command)}, e.g. {_example(command)}")


def _example(command: Command) -> str:
    return {"N": f"{command.name} 3", "on|off": f"{command.name} on"}.get(command.argument, f"{command.name} 1.5")
