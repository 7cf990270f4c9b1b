"""A value that is no choice of its parameter is refused when it is set, with the choices, by every node."""

from dataclasses import fields

import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters

from joint_id_core.options import names
from joint_id_ros.options.node_list import NODES

WITH_CHOICES = {
    node: [f for options in NODES[node] for f in fields(options) if f.metadata["choices"]] for node in NODES
}
AT_RUN_TIME = {"arm_identifier", "driver", "identifier"}  # the others read their parameters once: these are read-only
START = {node: {"autostart": False} for node in AT_RUN_TIME}


@pytest.mark.parametrize("node", [n for n, options in WITH_CHOICES.items() if options])
def test_what_is_no_choice_is_refused_with_the_choices(start, probe, node):
    process = start(node, **START.get(node, {}))
    options = WITH_CHOICES[node]
    described = probe.call(
        DescribeParameters, f"/{node}/describe_parameters", DescribeParameters.Request(names=[f.name for f in options])
    ).descriptors
    for f, descriptor in zip(options, described, strict=True):
        choices = names(f.metadata["choices"])
        assert descriptor.additional_constraints == f"one of: {choices}"
        bad = ["nonsense"] if isinstance(f.default, tuple) else "nonsense"
        result = probe.set_parameter(node, f.name, bad)
        assert not result.successful, f.name
        if node in AT_RUN_TIME:
            assert f.name in result.reason and f"'nonsense': choose one of {choices}" in result.reason
            good = f.metadata["choices"][-1]
            assert probe.set_parameter(node, f.name, [good] if isinstance(f.default, tuple) else good).successful
            got = probe.call(GetParameters, f"/{node}/get_parameters", GetParameters.Request(names=[f.name])).values[0]
            assert good in (got.string_value, *got.string_array_value)
        else:
            assert descriptor.read_only and "read-only" in result.reason
    assert process.running and "Traceback" not in process.text


def test_a_list_with_a_number_out_of_range_is_refused_too(start, probe):
    start("driver", autostart=False)
    result = probe.set_parameter("driver", "gear_ratio", [101.0, -1.0])
    assert not result.successful and "gear_ratio = -1.0" in result.reason
