"""The commands that the emulator takes while it runs."""

import math

import pytest

from joint_id_core.emulator.emulator import Emulator
from joint_id_core.emulator.faults import COMMANDS, parse, usage
from joint_id_core.errors import JointIdError


@pytest.mark.parametrize(
    ("line", "name", "value"),
    [
        ("drop", "drop", 1.0),
        ("drop 7", "drop", 7.0),
        ("  stall  0.25 ", "stall", 0.25),
        ("stall", "stall", 2.0),
        ("power-cycle 0", "power-cycle", 0.0),
        ("clock-jump -3.5", "clock-jump", -3.5),
        ("fragment on", "fragment", 1.0),
        ("fragment off", "fragment", 0.0),
        ("garbage", "garbage", 64.0),
    ],
)
def test_commands_are_understood(line, name, value):
    assert parse(line) == (name, value)


def test_a_command_without_an_argument_has_none():
    name, value = parse("kill")
    assert name == "kill"
    assert math.isnan(value)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("explode", "unknown command 'explode': the commands are drop, stall"),
        ("drop 0", "write drop [N=1], e.g. drop 3"),
        ("drop 1.5", "write drop"),
        ("drop -1", "write drop"),
        ("drop 1e9", "write drop"),
        ("drop x", "write drop"),
        ("drop 1 2", "write drop"),
        ("kill 3", "write kill"),
        ("stall -1", "write stall [S=2], e.g. stall 1.5"),
        ("stall nan", "write stall"),
        ("stall inf", "write stall"),
        ("clock-jump", "needs an argument: write clock-jump +-S"),
        ("clock-jump inf", "write clock-jump"),
        ("fragment", "needs an argument: write fragment on|off"),
        ("fragment maybe", "e.g. fragment on"),
    ],
)
def test_a_wrong_command_is_one_line_that_says_how_to_write_it(line, says):
    with pytest.raises(JointIdError) as error:
        parse(line)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_every_command_can_be_carried_out_and_explains_itself(command):
    assert callable(getattr(Emulator, f"_{command.name.replace('-', '_')}"))
    assert usage(command).startswith(command.name)
    assert command.meaning
