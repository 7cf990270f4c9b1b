"""ROS parameters carry meaning, unit, range and default of the options they are made from."""

from dataclasses import dataclass, fields

import pytest
import rclpy
from rclpy.parameter import Parameter

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.online.options import OnlineOptions
from joint_id_core.options import check, option
from joint_id_core.simulation.plants import MotionOptions
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.options.sim import SimOptions
from joint_id_ros.parameters import PARAMETER_ERRORS, declare, read


@dataclass(frozen=True)
class Sample:
    """Options of every kind."""

    gain: float = option(2.0, "a gain", "Nm", 0.5, 4.0)
    speed: float = option(1.0, "a speed", "rad/s", lower=0.0)
    count: int = option(3, "a count", lower=1)
    law: str = option("a", "a law", choices=("a", "b"))
    names: tuple[str, ...] = option((), "names")
    steps: tuple[float, ...] = option((1.0, 0.0), "steps", lower=-10.0)
    laws: tuple[str, ...] = option((), "laws", choices=("a", "b"))

    def __post_init__(self) -> None:
        check(self)


@pytest.fixture
def make(domain):
    rclpy.init()
    nodes = []

    def begin(**overrides):
        nodes.append(rclpy.create_node("n", parameter_overrides=[Parameter(k, value=v) for k, v in overrides.items()]))
        return nodes[-1]

    yield begin
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def test_defaults_and_overrides_come_back_as_options(make):
    node = make()
    declare(node, Sample)
    assert read(node, Sample) == Sample()
    node = make(gain=3.0, names=["x", "y"], steps=[0.0, 5.0])
    declare(node, Sample)
    assert read(node, Sample) == Sample(gain=3.0, names=("x", "y"), steps=(0.0, 5.0))


def test_descriptors_hold_meaning_unit_range_and_choices(make):
    node = make()
    declare(node, Sample)
    gain, speed, count, law = (node.describe_parameter(n) for n in ("gain", "speed", "count", "law"))
    assert gain.description == "a gain [Nm]" and gain.read_only
    assert (gain.floating_point_range[0].from_value, gain.floating_point_range[0].to_value) == (0.5, 4.0)
    assert speed.floating_point_range[0].to_value == float("inf")
    assert count.integer_range[0].from_value == 1
    assert law.additional_constraints == "one of: a, b"


@pytest.mark.parametrize(
    "overrides",
    [
        {"gain": 9.0},
        {"gain": "high"},
        {"count": 0},
        {"law": "c"},
        {"steps": [0.0, -11.0]},
        {"steps": [float("nan")]},
        {"laws": ["a", "c"]},
    ],
)
def test_a_value_of_the_wrong_type_or_range_is_refused_by_name(make, overrides):
    node = make(**overrides)
    with pytest.raises((JointIdError, *PARAMETER_ERRORS), match=next(iter(overrides))):
        declare(node, Sample)
        read(node, Sample)


@pytest.mark.parametrize(
    "options", [FilterOptions, InputOptions, IdentifierOptions, OnlineOptions, SimOptions, MotionOptions]
)
def test_every_parameter_of_the_nodes_is_described(make, options):
    node = make()
    declare(node, options)
    assert read(node, options) == options()
    for f in fields(options):
        assert len(node.describe_parameter(f.name).description) > 5
