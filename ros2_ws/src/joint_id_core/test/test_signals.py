"""How channels and models name what belongs together."""

from __future__ import annotations

import pytest

from joint_id_core.data.signals import CHANNELS, across_gear, derivative_of, integral_of, side_of
from joint_id_core.models import MODELS, build


def test_derivatives_and_sides_of_channels():
    assert derivative_of("motor_position") == "motor_velocity"
    assert derivative_of("wheel_velocity") == "wheel_acceleration"  # a signal of one's own
    assert integral_of("link_acceleration") == "link_velocity"
    assert [derivative_of(name) for name in ("link_acceleration", "torque", "position")] == [None] * 3
    assert [integral_of(name) for name in ("motor_position", "external_torque")] == [None] * 2
    assert across_gear("motor_velocity") == "link_velocity" and across_gear("link_position") == "motor_position"
    assert (across_gear("current"), side_of("current"), side_of("wheel_velocity")) == (None, None, None)
    for name in CHANNELS:
        if side_of(name) and (rate := derivative_of(name)) is not None:  # a command has no velocity
            assert integral_of(rate) == name and rate in CHANNELS
            assert CHANNELS[rate].unit.startswith("rad/s") and side_of(rate) == side_of(name)


@pytest.mark.parametrize("name", MODELS)
def test_what_a_model_says_of_its_inputs(name):
    model = build(name)
    voltage = name in ("dc_motor", "electromechanical")
    assert model.drive == ("voltage" if voltage else "torque")
    assert model.torque_drive == (None if voltage else "torque")
    assert model.load == (None if name == "motor_side" else "external_torque")
    assert model.gear_ratio(model.values()) == {"dc_motor": 1.0, "rigid_joint": 1.0}.get(name, 101.0)
    assert model.has_torque_offset == (name in ("rigid_joint", "motor_side")) and not model.has_gravity
    assert model.cubic_stiffness == (None if name in ("dc_motor", "rigid_joint") else "k_2")
    if not voltage:
        driven = build(name, actuation="current")
        assert (driven.drive, driven.torque_drive) == ("current", "current")
        assert driven.torque_constant(driven.values({"k_t": 0.1})) == 0.1


@pytest.mark.parametrize("name", ["harmonic_drive", "motor_side"])
def test_the_twist_balances_the_drive(name):
    """The spring, friction and inertia take up the torque, in either direction."""
    model = build(name, actuation="current")
    p = type("P", (), model.values({"k_t": 0.2, "k_2": 5e7}))
    for current in (0.5, -0.5):
        twist = model.twist_under(current, 3.0, 10.0, p)
        spring = p.k_1 * twist + p.k_2 * twist**3
        assert 0.2 * current == pytest.approx(spring / p.N + p.c_m * 3.0 + p.tau_fm + p.J_m * 10.0, rel=1e-2)
    assert build("rigid_joint").twist_under(1.0, 0.0, 0.0, None) == 0.0
