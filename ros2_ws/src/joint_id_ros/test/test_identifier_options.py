"""What `set`, `fix` and `free` say of one joint holds there alone and wins over what they say of all joints."""

import pytest
import yaml

from joint_id_core.errors import JointIdError
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict
from joint_id_core.results.ros_params import parameter_file
from joint_id_ros.options.identifier import IdentifierOptions


def test_a_value_of_one_joint_wins_over_that_of_all_whatever_the_order():
    for texts in (("k_t=0.1", "elbow_joint.k_t=0.0802", "N=101"), ("elbow_joint.k_t=0.0802", "N=101", "k_t=0.1")):
        options = IdentifierOptions(set=texts)
        assert options.values("elbow_joint") == {"k_t": 0.0802, "N": 101.0}
        assert options.values("wrist_1_joint") == {"k_t": 0.1, "N": 101.0}
        assert options.values("") == {"k_t": 0.1, "N": 101.0}


def test_a_held_value_wins_over_a_start_value_of_the_same_joints():
    options = IdentifierOptions(set=("k_2=1", "elbow.k_2=2", "elbow.c_1=3"), fix=("k_2=5", "wrist.k_2=6", "c_1=7"))
    assert options.values("elbow") == {"k_2": 2.0, "c_1": 3.0}
    assert options.values("wrist") == {"k_2": 6.0, "c_1": 7.0}
    assert options.values("base") == {"k_2": 5.0, "c_1": 7.0}


def test_parameters_are_held_and_freed_by_joint():
    options = IdentifierOptions(fix=("c_1", "k_2=0", "elbow.J_m"), free=("dtheta_0", "elbow.k_2", "wrist.N"))
    assert (options.fixed("base"), options.freed("base")) == (["c_1", "k_2"], ["dtheta_0"])
    assert (options.fixed("elbow"), options.freed("elbow")) == (["c_1", "J_m"], ["dtheta_0", "k_2"])
    assert (options.fixed("wrist"), options.freed("wrist")) == (["c_1", "k_2"], ["dtheta_0", "N"])


def test_names_of_joints_may_hold_a_prefix_and_dots():
    options = IdentifierOptions(set=("left/arm.v2_elbow_joint.k_t = 0.08", " tool.k_t=.2"))
    assert options.values("left/arm.v2_elbow_joint") == {"k_t": 0.08}
    assert options.values("tool") == {"k_t": 0.2}


def test_joints_that_are_named_are_expected():
    assert IdentifierOptions().expected == IdentifierOptions(set=("N=101",)).expected == ()
    assert IdentifierOptions(set=("b.N=1", "a.k_t=1"), fix=("c.N",), free=("b.k_2",)).expected == ("b", "a", "c")
    assert IdentifierOptions(joints=("a", "b"), set=("b.N=1",)).expected == ("a", "b")


@pytest.mark.parametrize("parameter", ["set", "fix", "free"])
def test_a_joint_that_is_not_identified_is_refused_with_those_that_are(parameter):
    text = "elbow.k_2" if parameter == "free" else "elbow.k_2=0"
    with pytest.raises(JointIdError) as error:
        IdentifierOptions(joints=("elbow_joint", "wrist_1_joint"), **{parameter: (text,)})
    for part in (f"parameter {parameter}", repr(text), "joint elbow,", "elbow_joint, wrist_1_joint"):
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("parameter", "text"),
    [("set", t) for t in ("k_t", "elbow.k_t", "k_t=", "=0.1", "elbow.=0.1", ".k_t=0.1", "k_t=high", "k_t=0.1=2", "")]
    + [("fix", t) for t in ("", ".c_1", "elbow.", "c_1=", "c_1=high", "=1")]
    + [("free", t) for t in ("", ".c_1", "elbow.", "c_1=1", "elbow.c_1=1", "a b")],
)
def test_a_text_of_another_form_is_refused_with_an_example(parameter, text):
    with pytest.raises(JointIdError) as error:
        IdentifierOptions(**{parameter: (text,)})
    assert f"parameter {parameter}: {text!r} is not of the form NAME" in str(error.value)
    assert "elbow_joint." in str(error.value)


def test_a_parameter_that_is_spoken_of_twice_is_refused():
    with pytest.raises(JointIdError, match=r"parameter set: 'elbow.k_t=0.2' speaks of k_t again"):
        IdentifierOptions(set=("elbow.k_t=0.1", "k_t=0.1", "elbow.k_t=0.2"))


@pytest.mark.parametrize("option", [{"cell": "implicit"}, {"priors": "k_t=0.05"}])
def test_options_of_innovations_are_refused_with_another_estimator(option):
    with pytest.raises(JointIdError, match="cell and priors are for the innovations estimator"):
        IdentifierOptions(estimator="hpinn", **option)
    assert IdentifierOptions(estimator="innovations", **option)


def test_a_drive_is_given_or_either():
    assert IdentifierOptions(model="rigid_joint").drives == ("torque", "current")
    assert IdentifierOptions(model="rigid_joint", actuation="current").drives == ("current",)
    assert "k_t" in IdentifierOptions(model="rigid_joint").build("current").parameter_names
    assert "k_t" not in IdentifierOptions(model="rigid_joint").build("torque").parameter_names
    assert IdentifierOptions(model="electromechanical").build("torque").name == "electromechanical"


def test_exported_estimates_are_what_the_identifier_starts_from():
    model = build("motor_side", actuation="current")
    values = {"J_m": 7e-5, "c_1": 12.0, "k_2": 3e5, "N": 101.0, "k_t": 0.1}
    rows = tuple(
        ParameterEstimate(
            p.name, p.unit, values.get(p.name, p.nominal), 0.006 if p.name == "k_t" else float("nan"),
            Verdict.ESTIMATED if p.name in ("J_m", "c_1") else Verdict.NOT_EXCITED,
        )
        for p in model.parameters
    )  # fmt: skip
    free = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "dtheta_0")  # one that the table holds; tau_0 and k_2 are held here
    options_ = {"actuation": "current", "friction": "coulomb_viscous", "delays": False}
    estimate = Estimate("motor_side", "innovations", Status.CONVERGED, "", rows, free, model_options=options_)
    content = yaml.safe_load(parameter_file({"elbow": estimate}, {"elbow": "made up"}))
    given = content["/**/identifier"]["ros__parameters"]
    options = IdentifierOptions(**{n: tuple(v) if isinstance(v, list) else v for n, v in given.items()})
    assert options.joints == ("elbow",) and options.drives == ("current",)
    settings = options.settings("elbow")
    assert settings.values == {"J_m": 7e-5, "c_1": 12.0, "k_2": 3e5, "k_t": 0.1, "tau_0": 0.0}  # N is that of the table
    assert set(settings.fixed) == {"k_2", "tau_0"} and list(settings.freed) == ["dtheta_0"]
    assert options.deviations("elbow") == {"k_t": 0.006}
