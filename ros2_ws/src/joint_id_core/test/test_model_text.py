"""Candidates of a comparison from their short texts."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.comparison.model_text import drive_of, parse
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import LAWS, build
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate


def recording(*channels: str) -> Recording:
    return Recording(np.arange(3.0), {name: np.arange(3.0) for name in channels}, source="log.csv")


RIGID = recording("link_position", "torque")


def labels(texts: list[str], record: Recording = RIGID) -> list[str]:
    return [c.label for c in parse(texts, record)]


def test_a_text_says_model_law_and_options():
    plain, full = parse(["rigid_joint", " harmonic_drive:stribeck + kinematic-error+gravity "], RIGID)
    assert plain.label == "rigid_joint:coulomb_viscous"
    assert plain.model == build("rigid_joint", actuation="torque")
    assert full.label == "harmonic_drive:stribeck+gravity+kinematic_error"
    assert full.model == build("harmonic_drive", friction="stribeck", gravity=True, kinematic_error=True)
    assert full.arguments == (
        "--model", "harmonic_drive", "--friction", "stribeck", "--gravity", "--kinematic-error"
    )  # fmt: skip


def test_one_model_without_a_law_and_the_law_all_stand_for_every_law():
    assert labels(["rigid_joint"]) == [f"rigid_joint:{law}" for law in LAWS]
    assert labels(["rigid_joint+gravity"]) == [f"rigid_joint:{law}+gravity" for law in LAWS]
    assert labels(["motor_side:all", "rigid_joint"]) == [
        *(f"motor_side:{law}" for law in LAWS), "rigid_joint:coulomb_viscous"
    ]  # fmt: skip


def test_the_drive_is_the_one_that_was_recorded_unless_it_is_said():
    both = recording("link_position", "torque", "current")
    (torque, _, _), (current, _, _) = parse(["rigid_joint"], both), parse(["rigid_joint"], recording("current"))
    assert (torque.model.inputs[0].name, current.model.inputs[0].name) == ("torque", "current")
    a, b = parse(["rigid_joint+current", "rigid_joint"], both)
    assert (a.model.inputs[0].name, b.model.inputs[0].name) == ("current", "torque")
    assert (a.label, a.arguments[-2:]) == ("rigid_joint:coulomb_viscous+current", ("--actuation", "current"))
    assert drive_of("dc_motor", both) is None


@pytest.mark.parametrize(
    ("channels", "models"),
    [
        (("link_position", "torque"), {"rigid_joint"}),
        (("link_position", "motor_velocity", "current"), {"rigid_joint", "harmonic_drive"}),
        (("link_position", "motor_velocity", "voltage"), {"electromechanical"}),
        (("motor_velocity", "current", "voltage"), {"dc_motor"}),
    ],
)
def test_without_a_text_the_recording_chooses(channels, models):
    assert set(labels([], recording(*channels))) == {f"{model}:{law}" for model in models for law in LAWS}


@pytest.mark.parametrize(("load", "option"), [(0.0, ""), (8.0, "+gravity")])
def test_without_a_text_gravity_is_among_them_where_the_motion_shows_it(load, option):
    time = np.arange(0.0, 8.0, 0.004)
    torque = multisine(time, 25.0, (0.3, 0.9, 2.1), seed=2)
    model = build("rigid_joint", gravity=True)
    moved = simulate(model, time, {"torque": torque}, model.values({"a_g": load, "b_g": 0.3 * load}))
    seen = Sensors(noise={"link_position": 1e-5}).measure(moved, 1, keep=("link_position", "torque"))
    assert [c.label for c in parse([], seen)] == [f"rigid_joint:{law}{option}" for law in LAWS]


def test_a_recording_that_suits_no_model_asks_for_names():
    with pytest.raises(JointIdError, match=r"log.csv holds motor_velocity: no model follows .*joint-id info .*--map"):
        parse([], recording("motor_velocity"))
