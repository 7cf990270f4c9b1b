"""The whole system: a simulated joint is identified live, one that picks up a load, an emulated robot, a recorded bag.

    make demo                                           or, in a sourced workspace: python demo/demo.py

Every node is a process of its own; they talk over DDS, on a ROS domain that only this run uses.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import time
from pathlib import Path

import acts
from live import History, free, summary
from load import INERTIA, report
from nodes import NodeFailedError
from ros_domain import own_domain

from joint_id_core import formats
from joint_id_core.cell.kernel import compile_model
from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive, Model
from joint_id_core.simulation.plants import PLANTS, MotionOptions, PositionControl
from joint_id_msgs.msg import ParameterEstimate

ROOT = Path(__file__).resolve().parent.parent
MIN_DURATION_S = 6.0  # a window for the estimate of the picture, and the motion that it predicts
HONEST = 3.0  # standard deviations; a larger error is pointed out


def main() -> int:
    """Run the acts; return 0 if parameters were estimated in every act with nodes."""
    begun = time.monotonic()
    args = _arguments()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)  # both end the demo like Ctrl-C
    try:
        with own_domain():
            estimated = _run(args, begun)
    except KeyboardInterrupt:
        print("\nstopped: every node has ended")
        return 130
    except (NodeFailedError, JointIdError, OSError) as error:
        print(f"\ndemo: {error}", file=sys.stderr)
        return 1
    _summary(args, estimated, time.monotonic() - begun)
    return 0 if all(map(_arrived, estimated.values())) else 1


def _run(args: argparse.Namespace, begun: float) -> dict[str, History]:
    """Run the acts one after the other; return the estimates of each."""
    model = PLANTS[args.model]({}, MotionOptions(), 0).model
    _compile(model)
    print(f"Act 1, live: sim -> filter -> identifier, {args.duration:g} s of {args.model}; a bag is recorded")
    print(f"The start values of the identifier are wrong by a factor of up to {acts.START_FACTOR:g}.", flush=True)
    live = acts.live(args, model, begun)
    print("\nAct 2, a load: sim -> filter -> identifier, a joint under position control", flush=True)
    print(f"While it moves, {INERTIA} is multiplied by {acts.LOAD_FACTOR:g}; the identifier is not told.", flush=True)
    _compile(HarmonicDrive(actuation="current"))
    load = acts.load(args)
    print(report(load))
    print("\nAct 3, an emulated UR robot: RTDE over TCP -> driver -> filter -> identifier")
    print("The connection is cut once; the driver reconnects.", flush=True)
    robot, joints, truth, driver = acts.robot(args)
    print(f"  the driver says: {driver}; all joints at the end:")
    print(summary(joints, truth, ("k_1", "J_q")))
    print(f"\nAct 4, from the bag of act 1: player -> filter -> identifier, {args.out / 'recording'}")
    print(f"It is played at {acts.REPLAY_RATE:g} times its speed.", flush=True)
    replayed = acts.replay(args, model)
    print("\nAct 5, a picture of fit, load and convergence", flush=True)
    from picture import draw  # here, so that nobody waits for matplotlib before the first estimate

    draw(args.picture, model, formats.read(args.out / "recording"), live, load)
    return {"live": live, "load": load, "robot": robot, "from the bag": replayed}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--model", choices=list(PLANTS), default=next(iter(PLANTS)), help="joint (default: %(default)s)"
    )
    parser.add_argument("--duration", type=float, default=20.0, help="motion in s (default: %(default)s)")
    parser.add_argument("--picture", type=Path, default=ROOT / "out/demo/demo.png", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=ROOT / "out/demo", help="bag and logs (default: %(default)s)")
    args = parser.parse_args()
    if not MIN_DURATION_S <= args.duration <= 3600.0:
        parser.error(f"--duration {args.duration:g}: give {MIN_DURATION_S:g} s to 3600 s")
    return args


def _compile(model: Model) -> None:
    """Compile the model before anything moves; if it is not in the cache, the compiler prints a line."""
    logger = logging.getLogger("joint_id_core.cell.kernel")
    logger.handlers = [logging.StreamHandler(sys.stdout)]
    logger.setLevel(logging.INFO)
    compile_model(model)


def _arrived(history: History) -> bool:
    """Whether parameters were estimated, with their uncertainties."""
    return any(p.verdict == p.ESTIMATED and p.std_dev > 0.0 for p in _last(history))


def _last(history: History) -> list[ParameterEstimate]:
    return free(history.estimates[-1]) if history.estimates else []


def _summary(args: argparse.Namespace, estimated: dict[str, History], elapsed: float) -> None:
    print()
    for title, history in estimated.items():
        if not _arrived(history):
            print(f"  {title}: no parameter was estimated: see {args.out / 'logs'}")
            continue
        sigma, name = max((abs(history.error(p)), p.name) for p in _last(history) if p.std_dev > 0.0)
        note = "" if sigma <= HONEST else ": larger than the standard deviation allows"
        print(f"  {title}: {len(history.estimates)} estimates, largest error at the end {sigma:.1f} σ ({name}){note}")
    bag = args.out / "recording"
    print(f"  recording: {bag}\n  picture:   {args.picture}\n  logs:      {args.out / 'logs'}")
    drive = f" --set k_t={PositionControl.K_T!r}" if args.model == PositionControl.MODEL else ""
    other = next(name for name in PLANTS if name != args.model)
    print(
        f"  done in {elapsed:.0f} s. Try next:\n"
        f"    .venv/bin/joint-id fit {bag} --model {args.model}{drive}\n"
        f"    .venv/bin/joint-id info {bag}\n"
        f"    setup/run python demo/demo.py --model {other} --duration 30"
    )


if __name__ == "__main__":
    sys.exit(main())
