"""What the identifier says of its joints on /diagnostics."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus

from joint_id_msgs.msg import JointEstimate
from joint_id_ros.diagnostics import Health
from joint_id_ros.identifier_health import IdentifierHealth


def _told(**joints) -> Health:
    """Return the report on joints, each with its status and message."""
    worker = SimpleNamespace(lag_s=lambda: 0.0, missed=0, waiting=(), backlog=0, left_out=0, busy_s=0.0)
    sources = SimpleNamespace(complaints=(), slowest_s=0.0, values=dict)
    knowledge = SimpleNamespace(refused=(), store=SimpleNamespace(values=dict, problem=""))
    latest = {
        name: {"message": message, "status": status, "solve_time": 0.0, "age": 0.0, "parameters": (), "free": (),
               "drifts": ()} for name, (status, message) in joints.items()
    }  # fmt: skip
    return IdentifierHealth().report(latest, {}, worker, sources, knowledge, SimpleNamespace(joints=()))


def test_sentences_of_several_joints_are_joined_without_their_full_stops():
    short = (JointEstimate.TOO_SHORT, "Too few samples: move it.")
    health = _told(elbow=short, wrist=short)
    assert health.message == "elbow: Too few samples: move it; wrist: Too few samples: move it"
    assert health.level == DiagnosticStatus.WARN


def test_a_joint_that_rests_is_no_warning_which_would_last_all_night():
    rests, good = (JointEstimate.NO_MOTION, "The joint rests."), (JointEstimate.CONVERGED, "converged")
    health = _told(elbow=good, lift=good, wrist=rests)
    assert (health.level, health.message) == (DiagnosticStatus.OK, "identified 2 joints; at rest: wrist")
    assert _told(elbow=rests, wrist=rests).message == "at rest: elbow, wrist"
    assert health.values["wrist: status"] == "The joint rests."


def test_a_warning_of_another_joint_names_the_one_that_rests_too():
    health = _told(elbow=(JointEstimate.POOR_FIT, "Try another model."), wrist=(JointEstimate.NO_MOTION, "It rests."))
    assert (health.level, health.message) == (DiagnosticStatus.WARN, "elbow: Try another model; at rest: wrist")
