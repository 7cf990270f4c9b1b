"""What the identifier says of its joints on /diagnostics."""

from types import SimpleNamespace

from joint_id_msgs.msg import JointEstimate
from joint_id_ros.identifier_health import IdentifierHealth


def test_sentences_of_several_joints_are_joined_without_their_full_stops():
    worker = SimpleNamespace(lag_s=lambda: 0.0, missed=0, waiting=(), backlog=0, left_out=0, busy_s=0.0)
    sources = SimpleNamespace(complaints=(), slowest_s=0.0, values=dict)
    knowledge = SimpleNamespace(refused=(), store=SimpleNamespace(values=dict, problem=""))
    rests = {"message": "The joint rests: move it.", "status": JointEstimate.NO_MOTION, "solve_time": 0.0, "age": 0.0,
             "parameters": (), "free": (), "drifts": ()}  # fmt: skip
    joints = {"elbow": rests, "wrist": rests}
    health = IdentifierHealth().report(joints, {}, worker, sources, knowledge, SimpleNamespace(joints=()))
    assert health.message == "elbow: The joint rests: move it; wrist: The joint rests: move it"
