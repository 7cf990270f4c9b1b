"""How long other ways to fit Model 2 take, and how near they come, beside `joint_id` on the same recordings.

    .venv/bin/python -m pip install -r benchmarks/requirements.txt -c benchmarks/constraints.txt -c constraints.txt
    setup/run python benchmarks/speed_peers.py --json out/benchmarks/speed_peers.json

The recordings are 2 s of a position-controlled joint with exact stick and slip, all four states measured with noise,
one without and one with noise of the measured torque. Every peer (`benchmarks/peers`) is a process of its own on one
core and fits from the same random starts. `peers/results.py` says what counts as converged. Times are processor time:
wall time of a core that does nothing else. Set-up is import and compilation with empty caches; ours stays on disk.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from peers.model2 import FREE, MODEL, Data
from peers.process import SINGLE_CORE, Peer
from peers.results import OURS, Run, table

from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

# Modules of benchmarks/peers, with how many starts at most: the slow ones get few.
PEERS = {
    OURS: 100,
    "casadi_nlp": 100,
    "casadi_disturbance": 100,
    "jax_optimistix": 100,
    "scipy_least_squares": 3,
    "torch_rmsprop": 1,
}
LIBRARIES = ("numpy", "scipy", "numba", "torch", "jax", "jaxlib", "optimistix", "casadi")
SENSORS = Sensors(noise={"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3})
TORQUE_NOISE = (0.0, 0.003)  # Nm at the motor
RATE = 500  # Hz


def recording(samples: int, torque_noise: float, seed: int) -> Data:
    """A multisine in closed loop, as the sensors see it; `torque_noise` in Nm at the motor."""
    time = np.arange(samples) / RATE
    motion = simulate_closed_loop(
        MODEL, PositionController(), position_reference(), time, torque_noise=torque_noise, seed=seed
    )
    sigma = np.array([SENSORS.noise[name] for name in MODEL.state_names])
    return Data(SENSORS.measure(motion, seed), sigma, torque_noise)


def random_start(k: int, factor: float) -> dict[str, float]:
    """Each parameter off by up to `factor`, up or down."""
    off = np.exp(np.log(factor) * np.random.default_rng(100 + k).uniform(-1.0, 1.0, len(FREE)))
    return {name: MODEL.parameter(name).nominal * by for name, by in zip(FREE, off.tolist(), strict=True)}


def measure(
    peers: Mapping[str, int], recordings: Mapping[float, Data], starts: int, factor: float, limit_s: float
) -> tuple[list[Run], dict[str, float]]:
    """Runs of every peer (given with its largest number of starts), and by peer what its import took in s."""
    runs, imports = [], {}
    for name, most in peers.items():
        peer = Peer(name, limit_s)
        imports[name] = peer.import_s
        for torque_noise, data in recordings.items():
            for k in range(1 if peer.missing else min(starts, most)):
                runs.append(peer.run(data, torque_noise, k, random_start(k, factor)))
                print(".", end="", file=sys.stderr, flush=True)
        peer.close()
    print(file=sys.stderr)
    return runs, imports


def machine() -> dict[str, str]:
    """Processor, Python, and versions of the libraries that are installed."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    found = {"processor": names[0] if names else platform.machine(), "python": platform.python_version()}
    for library in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[library] = metadata.version(library)
    return found


def main() -> None:
    """Measure, print the tables, and write all runs to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])

    def option(name: str, text: str, **kwargs: Any) -> None:
        parser.add_argument(f"--{name}", help=f"{text} (default: %(default)s)", **kwargs)

    option("peers", "whom to measure", nargs="+", choices=tuple(PEERS), default=list(PEERS))
    option("starts", "random starts a peer, fewer for slow ones", type=int, default=10)
    option("factor", "how far off a start value is at most", type=float, default=3.0)
    option("limit", "s of processor time that a run may take", type=float, default=120.0)
    option("samples", f"length of each recording at {RATE} Hz", type=int, default=1000)
    option("noise", "of the torque in Nm, one recording each", type=float, nargs="+", default=list(TORQUE_NOISE))
    option("seed", "of the noise of the recordings", type=int, default=1)
    option("json", "file for all runs", type=Path)
    args = parser.parse_args()
    recordings = {noise: recording(args.samples, noise, args.seed) for noise in args.noise}
    chosen = {name: most for name, most in PEERS.items() if name in args.peers}
    with tempfile.TemporaryDirectory() as cache:
        os.environ.update(SINGLE_CORE, JOINT_ID_CACHE_DIR=cache)
        runs, imports = measure(chosen, recordings, args.starts, args.factor, args.limit)
    print(table(runs, imports))
    if args.json:
        options = {name: value for name, value in vars(args).items() if name != "json"}
        rows = [{**asdict(run), "converged": run.converged} for run in runs]
        report = {"options": options, "machine": machine(), "import_s": imports, "runs": rows}
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
