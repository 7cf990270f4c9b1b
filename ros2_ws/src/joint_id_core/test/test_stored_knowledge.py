"""What is kept of a joint from run to run, under which age, and when it is stored."""

import threading

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.online.identifier import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate
from joint_id_core.stored.autosave import Autosave
from joint_id_core.stored.knowledge import StoredKnowledge
from joint_id_core.stored.state_file import StateFile

ORIGIN = 10**18


@pytest.fixture(scope="module")
def record():
    time = np.arange(5 * 250) / 250
    torque = multisine(time, 25.0, (0.5, 1.5, 2.5, 4.0), seed=5)
    rng = np.random.default_rng(0)
    acting = {"torque": torque + 0.1 * rng.standard_normal(len(time))}
    moved = simulate(build("rigid_joint"), time, acting, {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6})
    noisy = moved["link_position"] + 1e-5 * rng.standard_normal(len(time))
    return Recording(time, {"link_position": noisy, "torque": torque})


class Run:
    """Knowledge under a clock that the test sets."""

    def __init__(self, record, path=""):
        self.record, self.now, self.told = record, 1e9, []
        self.knowledge = StoredKnowledge(lambda kind, text: self.told.append(text), lambda: self.now)
        self.knowledge_path = path
        self.knowledge.open(path)
        self.settings = ParameterSettings()

    def make(self, joint="", samples=None):
        return OnlineIdentifier(build("rigid_joint"), self.settings, OnlineOptions(window_s=2.0))

    def begin(self, *joints):
        self.knowledge.begin(joints, lambda joint: [self.make()])

    def identify(self, joint="joint"):
        """Estimates of the record; the last one is stored."""
        identifier = self.knowledge.continued(self.make, joint, self.record)
        found = [identifier.update(self.record.slice(k, k + 25)) for k in range(0, len(self.record), 25)]
        found = [e for e in found if e is not None]
        for estimate in found:
            good = self.knowledge.add(joint, estimate, ORIGIN)
        assert found[-1].converged and good is found[-1]
        return found

    def restored(self, joint="joint"):
        return self.knowledge.restored[joint]


@pytest.fixture
def run(record, tmp_path):
    run = Run(record, str(tmp_path / "state.json"))
    yield run
    run.knowledge.store.close()


def again(run):
    """A new process with the same file, at the same time."""
    run.knowledge.store.close()
    other = Run(run.record, str(run.knowledge_path))
    other.now = run.now
    return other


def test_a_new_process_continues_with_the_age(run):
    last = run.identify()[-1]
    other = again(run)
    other.now += 3600.0
    other.begin()
    restored = other.restored()
    assert restored.gone_s == 3600.0 and restored.origin_ns == ORIGIN
    assert restored.estimate.values == last.values
    assert restored.estimate["J"].std_dev == pytest.approx(np.hypot(last["J"].std_dev, 0.1 * last["J"].value), rel=1e-6)
    assert "3600.0 s old" in restored.newest.message and restored.newest.status is Status.TOO_SHORT
    first = other.identify()[0]
    assert first.end < 1.0  # no first window
    assert "joint" not in other.knowledge.restored and not other.told


def test_restarts_without_motion_do_not_make_knowledge_younger(run, record):
    last = run.identify()[-1]
    for _ in range(3):
        run = again(run)
        run.now += 1200.0
        run.begin()
        still = Recording(record.time, {"link_position": np.zeros(len(record)), "torque": np.zeros(len(record))})
        identifier = run.knowledge.continued(run.make, "joint", still)
        good = run.knowledge.add("joint", identifier.update(still.slice(0, 250)), ORIGIN)
        assert good["J"].value == pytest.approx(last["J"].value) and good.converged
        assert good.end == pytest.approx(-1200.0, abs=1e-6)
    now = good["J"].std_dev / good["J"].value
    assert now == pytest.approx(np.sqrt(3.0) * 0.1 / 3.0, rel=0.05)


def test_a_clock_that_was_set_back_leaves_no_age(run):
    run.identify()
    other = again(run)
    other.now -= 86400.0
    other.begin()
    assert not other.knowledge.restored
    assert "was set back by 86400 s, so its age is not known" in other.told[0]
    assert other.knowledge.refused == other.told
    other.identify()
    assert not other.knowledge.refused


def test_other_settings_are_named_and_the_joint_starts_anew(run):
    run.identify()
    other = again(run)
    other.settings = ParameterSettings({"J": 3.0}, priors={"c": 0.5})
    other.begin()
    assert "the settings are others now (priors, values)" in other.told[0]
    assert other.identify()[0].end > 1.8  # a first window


def test_joints_that_are_not_identified_stay_in_the_file(run):
    run.identify("elbow")
    run.identify("wrist")
    other = again(run)
    other.begin("wrist")
    assert set(other.knowledge.restored) == {"wrist"}
    other.identify("wrist")
    other.knowledge.store.close()
    assert set(StateFile(str(run.knowledge_path)).read()) == {"elbow", "wrist"}


def test_a_joint_that_was_gone_continues_when_it_returns(run):
    run.begin()
    run.identify()
    run.knowledge.gone("joint")
    run.now += 5.0
    assert run.identify()[0].end < 1.0
    run.knowledge.forget_run()  # time jumped back: it may be another robot
    assert run.identify()[0].end > 1.8


def test_an_identifier_without_a_memory_leaves_nothing_to_continue(run, record):
    def without(*_):
        return OnlineIdentifier(build("rigid_joint"), options=OnlineOptions(memory_s=0.0))

    for _ in range(2):
        estimate = run.knowledge.continued(without, "joint", record).update(record)
        assert run.knowledge.add("joint", estimate, ORIGIN) is estimate
        run.knowledge.gone("joint")
    with pytest.raises(JointIdError, match="no such file"):
        run.knowledge.load()
    assert not run.told


def test_a_run_that_jumped_back_has_no_good_estimate_of_the_run_before(run, record):
    last = run.identify()[-1]
    failed = OnlineIdentifier(build("rigid_joint")).update(
        record.slice(0, 520).with_channels({"torque": np.full(520, np.nan)})
    )
    assert run.knowledge.add("joint", failed, ORIGIN) is last
    assert run.knowledge.add("joint", failed, ORIGIN + 1) is None


def test_without_a_file_knowledge_lasts_as_long_as_the_process(record):
    run = Run(record)
    run.identify()
    run.begin()
    assert run.restored().newest.message.startswith("Restored 0.0 s old")
    for service in (run.knowledge.save, run.knowledge.load):
        with pytest.raises(JointIdError, match="set the parameter state_file and configure"):
            service()
    assert run.knowledge.reset() == "forgot 1 joint"
    run.begin()
    assert not run.knowledge.restored


def test_nothing_is_written_while_nothing_is_new():
    written, told = [], []
    saver = Autosave(lambda: written.append(1), lambda kind, text: told.append(text))
    saver.flush()
    saver.close()
    assert not written and not told


def test_estimates_never_wait_for_a_disk_and_at_most_one_write_a_second_follows():
    gate, begun, count = threading.Event(), threading.Event(), []

    def slow():
        count.append(1)
        begun.set()
        assert gate.wait(60.0)

    saver = Autosave(slow, lambda kind, text: None)
    saver.ask()
    assert begun.wait(60.0)
    for _ in range(1000):
        saver.ask()  # returns although the disk hangs
    gate.set()
    saver.close()
    assert len(count) == 2


def test_a_write_that_fails_is_told_and_repeated():
    fails, told = [True], []

    def write():
        if fails[0]:
            raise JointIdError("the disk is full")

    saver = Autosave(write, lambda kind, text: told.append(text))
    with pytest.raises(JointIdError):
        saver.save()
    assert saver.problem == "the disk is full"
    fails[0] = False
    saver.close()
    assert saver.count == 1 and not saver.problem
