"""Node `identifier`: a configuration that it cannot use, and transitions that are not possible."""

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState


def test_options_of_the_other_estimator_are_refused(start, probe):
    process = start("identifier", model="rigid_joint", estimator="hpinn", cell="implicit", autostart=False)
    text = "cell and priors are for the innovations estimator: leave them out with hpinn"
    assert not probe.change("identifier", "configure")
    assert probe.set_parameter("identifier", "cell", "rk4").successful
    assert probe.set_parameter("identifier", "priors", "J=0.5").successful
    assert not probe.change("identifier", "configure")
    probe.until(lambda: process.text.count(text) == 2, "the reasons")
    assert probe.set_parameter("identifier", "priors", "").successful
    assert probe.change("identifier", "configure")


def test_a_bad_configuration_is_told_in_one_line_and_the_node_stays(start, probe):
    process = start("identifier", model="rigid_joint", actuation="torque", set=["mass=3"])
    first = "model rigid_joint has no parameter 'mass': it has J, c"
    probe.until(lambda: probe.told("identifier", first), "a diagnostic")
    assert probe.told("identifier", first).level == b"\x02"
    probe.set_parameter("identifier", "set", [""])
    for name, bad, good, text in (
        ("set", ["J=-1"], [""], "parameter J = -1 kg m^2 is outside its bounds"),
        ("set", ["J"], [""], "'J' is not of the form NAME=VALUE"),
        ("set", ["elbow.mass=1"], [""], "joint elbow: model rigid_joint has no parameter 'mass'"),
        ("fix", ["weight"], [""], "model rigid_joint has no parameter 'weight'"),
        ("actuation", "current", "torque", "model rigid_joint needs k_t"),
        ("kinematic_error", True, False, "model rigid_joint has no option 'kinematic_error'"),
    ):
        assert probe.set_parameter("identifier", name, bad).successful
        assert not probe.change("identifier", "configure")
        assert probe.set_parameter("identifier", name, good).successful
        assert len([line for line in process.text.splitlines() if text in line]) == 1
    assert probe.change("identifier", "configure")
    assert "Traceback" not in process.text


def test_a_bad_choice_at_the_start_is_told_and_can_be_mended(start, probe):
    process = start("identifier", model="flexible", actuation="torque")
    probe.until(lambda: probe.told("identifier", "option model = 'flexible': choose one of dc_motor"), "a diagnostic")
    assert probe.set_parameter("identifier", "model", "rigid_joint").successful
    assert probe.change("identifier", "configure")
    assert "Traceback" not in process.text


def test_a_transition_that_is_not_possible_is_refused_and_the_node_goes_on(start, probe):
    process = start("identifier", model="rigid_joint", actuation="torque", autostart=False)
    for transition in (Transition(id=Transition.TRANSITION_ACTIVATE), Transition(label="activate"), Transition(id=99)):
        request = ChangeState.Request(transition=transition)
        assert not probe.call(ChangeState, "/identifier/change_state", request).success
    assert "transition 3 is not possible: the node is unconfigured" in process.text
    assert probe.change("identifier", "configure")
    assert not probe.change("identifier", "deactivate")
    assert probe.change("identifier", "shutdown")
    probe.until(lambda: probe.told("identifier", "shut down"), "a report")
