"""Samples that each RTDE client loses at 500 Hz, side by side on the same emulated robot.

    setup/run python benchmarks/rtde_loss.py --duration 600

Every client is a process of its own, as a driver would be; all read the fields that the driver reads. A sample
counts as lost when its timestamp lies between the first and the last that the client delivered, and it delivered none
with it; as wrong when a field is not what the reference client, the one that keeps every byte, saw with that timestamp.
The emulator sends every tick of 2 ms with a timestamp of its own, late ones as well.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from cpu_time import cpu_s

from joint_id_core.emulator.process import EmulatorProcess
from joint_id_core.rtde.client import Request
from joint_id_core.rtde.clients import CLIENTS

HOST, PORT = "127.0.0.47", 30004  # the port of ur_rtde cannot be chosen
RATE = 500.0
FIELDS = ("timestamp", "actual_q", "actual_qd", "actual_current", "robot_mode", "safety_mode", "joint_mode")
COLUMNS = ("actual_q", "actual_qd", "actual_current")
GOAL_PERCENT = 0.01


def main() -> None:
    """Run all clients at once and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--duration", type=float, default=600.0, help="s (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"), help="folder (default: %(default)s)")
    parser.add_argument("--read", choices=tuple(CLIENTS), help=argparse.SUPPRESS)  # what a child process does
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.read:
        _read(args.read, args.duration, args.out)
        return
    with EmulatorProcess("--host", HOST, "--port", str(PORT)) as emulator:
        begun, before = time.monotonic(), cpu_s(emulator.process.pid)
        command = [sys.executable, __file__, "--duration", str(args.duration), "--out", str(args.out), "--read"]
        children = [subprocess.Popen([*command, name]) for name in CLIENTS]
        if any([child.wait() for child in children]):
            raise SystemExit("a client ended with an error")
        load = (cpu_s(emulator.process.pid) - before) / (time.monotonic() - begun)
    _table(args.out, load)


def _read(name: str, duration: float, out: Path) -> None:
    """Read for a while and keep everything."""
    client = CLIENTS[name](Request(HOST, FIELDS, RATE, PORT))
    client.open()
    client.start()
    rows, delays = [], []
    cpu, end = time.process_time(), time.monotonic() + duration
    begun = time.monotonic()
    while time.monotonic() < end:
        for sample in client.read(0.5):
            values: dict[str, Any] = sample.values
            rows.append([values["timestamp"], *(v for column in COLUMNS for v in values[column])])
            delays.append(sample.received_ns * 1e-9 - values["timestamp"])
    load = (time.process_time() - cpu) / (time.monotonic() - begun)
    client.close()
    np.savez(out / f"rtde_{name}.npz", rows=np.array(rows), delays=np.array(delays), load=load)


def _table(out: Path, emulator_load: float) -> None:
    data = {name: np.load(out / f"rtde_{name}.npz") for name in CLIENTS}
    reference = {round(row[0] * RATE): row for row in data["socket"]["rows"]}
    results = {}
    for name, found in data.items():
        ticks = np.round(found["rows"][:, 0] * RATE).astype(int)
        sent = int(ticks[-1] - ticks[0] + 1)
        wrong = sum(
            not np.array_equal(row, reference[k]) for k, row in zip(ticks, found["rows"], strict=True) if k in reference
        )
        delays = found["delays"] - np.min(found["delays"])
        results[name] = {
            "sent": sent,
            "lost": sent - len(np.unique(ticks)),
            "loss_percent": 100.0 * (sent - len(np.unique(ticks))) / sent,
            "repeated": len(ticks) - len(np.unique(ticks)),
            "wrong": int(wrong),
            "delay_ms_p50": 1e3 * float(np.quantile(delays, 0.5)),
            "delay_ms_p99": 1e3 * float(np.quantile(delays, 0.99)),
            "cpu_percent": 100.0 * float(found["load"]),
        }
    print(f"{'client':<10}" + "".join(f"{key:>15}" for key in results["socket"]))
    for name, result in results.items():
        print(f"{name:<10}" + "".join(f"{v:>15.4g}" if isinstance(v, float) else f"{v:>15}" for v in result.values()))
    print(f"goal: less than {GOAL_PERCENT} % lost. The emulator took {100 * emulator_load:.0f} % of a core.")
    (out / "rtde_loss.json").write_text(json.dumps({"clients": results, "emulator_load": emulator_load}, indent=1))


if __name__ == "__main__":
    main()
