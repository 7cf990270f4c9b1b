"""The acts of the demo that run nodes: a simulated joint live, an emulated robot through the driver, a bag replayed."""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml
from live import History, Screen, Watcher
from load import INERTIA
from nodes import Nodes

from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive, Model
from joint_id_core.online.options import OnlineOptions
from joint_id_core.simulation.plants import MotionOptions, PositionControl
from joint_id_msgs.msg import JointEstimate

READY_S = 60.0  # longest wait for a node that starts, or that should have ended
LAST_S = 30.0  # longest wait for the last estimate once the motion has ended
START_FACTOR = 2.0  # by which start values are wrong, at most: the table's values are those of the simulation
LOAD_S = 4.0 * OnlineOptions().window_s  # motion from the first estimate to the load; sooner it is a wrong start
LOAD_FACTOR = 2.0  # inertia of the link with the load over that without
FOLLOW_S = 2.0 * OnlineOptions().window_s  # motion after that
ROBOT_JOINT = "elbow_joint"  # the joint of the emulated robot that is shown while it moves
REPLAY_RATE = 2.0  # speed of the replay over that of the recording
HOST = "127.0.0.1"


def live(args: argparse.Namespace, model: Model, begun: float) -> History:
    """Sim, filter, identifier and recorder; returns what was estimated."""
    args.out.mkdir(parents=True, exist_ok=True)
    topics = ["link_states", "motor_states", "truth", *(["motor_voltages"] if "voltage" in model.input_names else [])]
    with (
        tempfile.TemporaryDirectory(dir=args.out, prefix="run_") as folder,
        Nodes(args.out / "logs/live") as nodes,
        Watcher() as watcher,
    ):
        bag = Path(folder) / "recording"
        nodes.node("filter")
        _start_identifier(nodes, watcher, model.name, _wrong(model))
        nodes.record(bag, topics)
        # The joint moves when filter and recorder listen: nothing of its motion is lost.
        nodes.node("sim", model=args.model, duration=args.duration, wait_subscribers=2)
        _follow(nodes, watcher, "sim", args.duration, Screen("live", begun))
        nodes.stop("record")
        _replace(bag, args.out / "recording")
        return watcher.history


def load(args: argparse.Namespace) -> History:
    """Sim, filter and identifier; the simulated joint picks up a load. Returns what was estimated."""
    model = PositionControl({}, MotionOptions(), 0).model
    screen = Screen("load", time.monotonic())
    with Nodes(args.out / "logs/load") as nodes, Watcher() as watcher:
        nodes.node("filter")
        _start_identifier(nodes, watcher, model.name, _wrong(model))
        nodes.node("sim", model=model.name, wait_subscribers=1)
        history = watcher.history
        _until(watcher, nodes, screen, lambda: history.moved_s >= history.known_s + LOAD_S, READY_S)
        watcher.set_parameter("sim", "set", [f"{INERTIA}={LOAD_FACTOR * history.truth[INERTIA]!r}"])
        _until(watcher, nodes, screen, lambda: history.moved_s >= history.changed_s + FOLLOW_S, READY_S)
        screen.finish(history)
        return history


def robot(args: argparse.Namespace) -> tuple[History, dict[str, JointEstimate], dict[str, dict[str, float]], str]:
    """Emulated robot, driver, filter, identifier; the connection is cut once.

    Returns what was estimated of one joint, the last estimate and the truth by joint, and the driver's last words.
    """
    screen = Screen(f"robot, {ROBOT_JOINT}", time.monotonic())
    truth_file = args.out / "logs/robot/truth.yaml"
    with Nodes(args.out / "logs/robot") as nodes, Watcher(ROBOT_JOINT) as watcher:
        nodes.node("filter")
        emulator = nodes.emulator(HOST, truth_file)
        truth = yaml.safe_load(truth_file.read_text())
        # Torque constants are known of a robot; all else starts at the values of the model's table.
        known = [f"{joint}.k_t={values['k_t']!r}" for joint, values in truth.items()]
        _start_identifier(nodes, watcher, HarmonicDrive.name, known)
        nodes.node("driver", robot_ip=HOST, port=emulator.port)
        history = watcher.history
        history.truth = truth[ROBOT_JOINT]
        _until(watcher, nodes, screen, lambda: bool(history.estimates), READY_S)
        for act in ("kill", None):
            half = time.monotonic() + args.duration / 2.0
            _until(watcher, nodes, screen, lambda half=half: time.monotonic() > half, args.duration)
            if act:
                emulator.tell(act)
        # A slow computer still works on the first windows of six joints.
        _wait(watcher, nodes, screen, lambda: all(_converged(watcher.latest.get(j)) for j in truth), READY_S)
        screen.finish(history)
        return history, watcher.latest, truth, watcher.said_by("driver", "received", "lost", "reconnects")


def _until(watcher: Watcher, nodes: Nodes, screen: Screen, condition: Callable[[], bool], patience_s: float) -> None:
    """Show the estimates until the condition holds.

    Raises:
        JointIdError: it does not hold in time.
    """
    if not _wait(watcher, nodes, screen, condition, patience_s):
        raise JointIdError(f"no estimate after {patience_s:g} s: see {nodes.logs}")


def _wait(watcher: Watcher, nodes: Nodes, screen: Screen, condition: Callable[[], bool], patience_s: float) -> bool:
    """Show the estimates until the condition holds; return whether it did in time."""
    limit = time.monotonic() + patience_s
    while not condition():
        nodes.check()
        watcher.spin()
        screen.show(watcher.history)
        if time.monotonic() > limit:
            return False
    return True


def _converged(estimate: JointEstimate | None) -> bool:
    return estimate is not None and estimate.status == JointEstimate.CONVERGED


def replay(args: argparse.Namespace, model: Model) -> History:
    """Player, filter and identifier, on the clock of the bag."""
    bag = args.out / "recording"
    screen = Screen("replayed", time.monotonic())
    with Nodes(args.out / "logs/replay") as nodes, Watcher() as watcher:
        nodes.node("filter", use_sim_time=True)
        _start_identifier(nodes, watcher, model.name, _wrong(model), use_sim_time=True)
        nodes.node("player", bag=bag, rate=REPLAY_RATE)
        _follow(nodes, watcher, "player", args.duration, screen)
        return watcher.history


def _wrong(model: Model) -> list[str]:
    """Start values for the identifier."""
    rng = np.random.default_rng(0)
    start = {p.name: p.nominal * START_FACTOR ** rng.uniform(-1.0, 1.0) for p in model.parameters if not p.fixed}
    if model.name == PositionControl.MODEL:
        # The torque constant is known of a motor; a motion under position control cannot show it.
        start["k_t"] = PositionControl.K_T
    return [f"{n}={v:.6g}" for n, v in start.items()]


def _start_identifier(nodes: Nodes, watcher: Watcher, model: str, start: list[str], **parameters: object) -> None:
    """Start the identifier and wait until it listens."""
    nodes.node("identifier", model=model, set=start, **parameters)
    limit = time.monotonic() + READY_S
    while not watcher.identifier_listens():
        nodes.check()
        watcher.spin()
        if time.monotonic() > limit:
            raise JointIdError(f"the identifier was not ready after {READY_S:g} s: see {nodes.logs}")


def _follow(nodes: Nodes, watcher: Watcher, source: str, duration: float, screen: Screen) -> None:
    """Show the estimates until the source has ended and the last one is there."""
    history = watcher.history
    limit = time.monotonic() + READY_S + duration
    while not nodes.ended(source):
        watcher.spin()
        screen.show(history)
        if time.monotonic() > limit:
            raise JointIdError(f"{source} still runs {READY_S:g} s after its time: see {nodes.logs}")
    limit = time.monotonic() + LAST_S
    final = duration - OnlineOptions().hop_s - 0.5  # the filter holds back the last 0.1 s
    while time.monotonic() < limit and not (history.estimates and history.time(history.estimates[-1]) >= final):
        nodes.check(may_end=source)
        watcher.spin()
        screen.show(history)
    screen.finish(history)


def _replace(new: Path, place: Path) -> None:
    """Put the finished recording in the place of an older one, which stays until the new one is complete."""
    if place.exists():
        if not (place / "metadata.yaml").is_file():
            raise JointIdError(f"{place} is no recording, so it is not replaced: move it or choose another --out")
        shutil.rmtree(place)
    new.rename(place)
