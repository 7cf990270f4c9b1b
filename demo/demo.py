"""The whole system at work: a simulated joint is identified live, then again from the bag recorded of it.

    make demo                                           or, in a sourced workspace: python demo/demo.py

Every node is a process of its own; they talk over DDS, on a ROS domain that only this run uses.
"""

from __future__ import annotations

import argparse
import logging
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from live import History, Screen, Watcher, free
from nodes import NodeFailedError, Nodes

from joint_id_core import formats
from joint_id_core.codegen import compile_model
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.online import OnlineOptions
from joint_id_msgs.msg import ParameterEstimate
from joint_id_ros.plants import PLANTS, MotionOptions, PositionControl

ROOT = Path(__file__).resolve().parent.parent
READY_S = 60.0  # longest wait for a node that starts, or that should have ended
LAST_S = 30.0  # longest wait for the last estimate once the motion has ended
MIN_DURATION_S = 6.0  # a window for the estimate of the picture, and the motion that it predicts
HONEST = 3.0  # standard deviations; a larger error is pointed out
START_FACTOR = 2.0  # by which start values are wrong, at most: the table's values are those of the simulation


def main() -> int:
    """Run the three acts; 0 when estimates arrived in both live acts."""
    begun = time.monotonic()
    args = _arguments()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # both end the demo like Ctrl-C
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # for the part of DDS in this process
    try:
        model = PLANTS[args.model]({}, MotionOptions(), 0).model
        _compile(model)
        live = _act_1(args, model, begun)
        replayed = _act_2(args, model)
        print("\nAct 3, the picture: fit and convergence", flush=True)
        from picture import draw  # here, so that nobody waits for matplotlib before the first estimate

        draw(args.picture, model, formats.read(args.out / "recording"), live)
    except KeyboardInterrupt:
        print("\nstopped: every node has ended")
        return 130
    except (NodeFailedError, JointIdError, OSError) as error:
        print(f"\ndemo: {error}", file=sys.stderr)
        return 1
    _summary(args, live, replayed, time.monotonic() - begun)
    return 0 if _arrived(live) and _arrived(replayed) else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--model", choices=list(PLANTS), default=next(iter(PLANTS)), help="joint (default: %(default)s)"
    )
    parser.add_argument("--duration", type=float, default=20.0, help="motion in s (default: %(default)s)")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs/images/demo.png", help="default: %(default)s")
    parser.add_argument("--out", type=Path, default=ROOT / "out/demo", help="bag and logs (default: %(default)s)")
    args = parser.parse_args()
    if not MIN_DURATION_S <= args.duration <= 3600.0:
        parser.error(f"--duration {args.duration:g}: give {MIN_DURATION_S:g} s to 3600 s")
    return args


def _compile(model: Model) -> None:
    """Compile the model before anything moves; the compiler says so when its cache has no such kernel."""
    logger = logging.getLogger("joint_id_core.codegen")
    logger.addHandler(logging.StreamHandler(sys.stdout))
    logger.setLevel(logging.INFO)
    compile_model(model)


def _act_1(args: argparse.Namespace, model: Model, begun: float) -> History:
    """Sim, filter, identifier and recorder; returns what was estimated."""
    print(f"Act 1, live: sim -> filter -> identifier, {args.duration:g} s of {args.model}, recorded at the same time")
    print(f"The start values of the identifier are wrong by a factor of up to {START_FACTOR:g}.", flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    topics = ["link_states", "motor_states", "truth", *(["motor_voltages"] if "voltage" in model.input_names else [])]
    with (
        tempfile.TemporaryDirectory(dir=args.out, prefix="run_") as folder,
        Nodes(args.out / "logs/live", _domain()) as nodes,
        Watcher(_domain()) as watcher,
    ):
        bag = Path(folder) / "recording"
        nodes.node("filter")
        _start_identifier(nodes, watcher, model)
        nodes.record(bag, topics)
        # The joint moves when filter and recorder listen: nothing of its motion is lost.
        nodes.node("sim", model=args.model, duration=args.duration, wait_subscribers=2)
        _follow(nodes, watcher, "sim", args.duration, Screen("live", begun))
        nodes.stop("record")
        _replace(bag, args.out / "recording")
        return watcher.history


def _act_2(args: argparse.Namespace, model: Model) -> History:
    """Player, filter and identifier, on the clock of the bag."""
    bag = args.out / "recording"
    print(f"\nAct 2, from the bag just recorded: player -> filter -> identifier, {bag}", flush=True)
    screen = Screen("replayed", time.monotonic())
    with Nodes(args.out / "logs/replay", _domain()) as nodes, Watcher(_domain()) as watcher:
        nodes.node("filter", use_sim_time=True)
        _start_identifier(nodes, watcher, model, use_sim_time=True)
        nodes.node("player", bag=bag)
        _follow(nodes, watcher, "player", args.duration, screen)
        return watcher.history


def _start_identifier(nodes: Nodes, watcher: Watcher, model: Model, **parameters: object) -> None:
    """Start the identifier from wrong values, and wait until it listens."""
    rng = np.random.default_rng(0)
    wrong = {p.name: p.nominal * START_FACTOR ** rng.uniform(-1.0, 1.0) for p in model.parameters if not p.fixed}
    if model.name == PositionControl.MODEL:
        # The torque constant is known of a motor; a motion under position control cannot show it.
        wrong["k_t"] = PositionControl.K_T
    nodes.node("identifier", model=model.name, set=[f"{n}={v:.6g}" for n, v in wrong.items()], **parameters)
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
    final = duration - OnlineOptions().hop_s - 0.5  # the filter holds back the last 0.14 s
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


def _domain() -> int:
    """The ROS domain of this run: 1 to 100, whose ports no other program is given by the system."""
    return 1 + os.getpid() % 100


def _arrived(history: History) -> bool:
    """Whether parameters were estimated, with their uncertainties."""
    return any(p.verdict == p.ESTIMATED and p.std_dev > 0.0 for p in _last(history))


def _last(history: History) -> list[ParameterEstimate]:
    return free(history.estimates[-1]) if history.estimates else []


def _summary(args: argparse.Namespace, live: History, replayed: History, elapsed: float) -> None:
    print()
    for title, history in (("live", live), ("from the bag", replayed)):
        if not _arrived(history):
            print(f"  {title}: no parameter was estimated: see {args.out / 'logs'}")
            continue
        sigma, name = max((abs(history.error(p)), p.name) for p in _last(history) if p.std_dev > 0.0)
        note = "" if sigma <= HONEST else ": more than the standard deviation explains"
        print(f"  {title}: {len(history.estimates)} estimates, largest error at the end {sigma:.1f} σ ({name}){note}")
    bag = args.out / "recording"
    print(f"  recording: {bag}\n  picture:   {args.picture}\n  logs:      {args.out / 'logs'}")
    drive = f" --set k_t={PositionControl.K_T!r}" if args.model == PositionControl.MODEL else ""
    other = next(name for name in PLANTS if name != args.model)
    print(
        f"  done in {elapsed:.0f} s. To try next:\n"
        f"    .venv/bin/joint-id fit {bag} --model {args.model}{drive}\n"
        f"    .venv/bin/joint-id info {bag}\n"
        f"    setup/run python demo/demo.py --model {other} --duration 30"
    )


if __name__ == "__main__":
    sys.exit(main())
