"""Participants of the middleware as processes: what discovery costs when there are many.

    python benchmarks/fleet_participants.py --participants 20 --nodes 1

Every process has one participant with so many nodes, as rclpy makes them, each with one topic of its own. It waits
until it sees all others. Prints as JSON: time until all see all, processor time until then and afterwards, and bytes
over the loopback.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
from multiprocessing.connection import Connection
from pathlib import Path

import rclpy
from cpu_time import cpu_s
from sensor_msgs.msg import JointState

PATIENCE_S = 120.0
LOOK_S = 0.25


def main() -> None:
    """Start the processes, measure, and end them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--participants", type=int, default=10, help="(default: %(default)s)")
    parser.add_argument("--nodes", type=int, default=1, help="of each participant (default: %(default)s)")
    parser.add_argument("--steady", type=float, default=10.0, help="s measured afterwards (default: %(default)s)")
    args = parser.parse_args()
    found = measured(args.participants, args.nodes, args.steady)
    print(json.dumps(found))


def measured(participants: int, nodes: int, steady: float) -> dict[str, float]:
    """Return the figures of so many participants with so many nodes each."""
    context = multiprocessing.get_context("fork")  # everything is imported already
    children, pipes = [], []
    begun, sent = time.monotonic(), _loopback_bytes()
    for k in range(participants):
        here, there = context.Pipe()
        children.append(context.Process(target=_participant, args=(k, nodes, participants * nodes, there), daemon=True))
        pipes.append(here)
        children[-1].start()
    seen = [pipe.recv() for pipe in pipes]
    took = time.monotonic() - begun
    cost, bytes_ = sum(cpu_s(child.pid or 0) for child in children), _loopback_bytes() - sent
    sent = _loopback_bytes()
    time.sleep(steady)
    later = sum(cpu_s(child.pid or 0) for child in children) - cost
    figures = {
        "participants": participants, "nodes": participants * nodes, "complete": float(sum(seen)), "match [s]": took,
        "cpu to match [s]": cost, "bytes to match": float(bytes_), "steady [% of a core]": 100.0 * later / steady,
        "steady [bytes/s]": (_loopback_bytes() - sent) / steady, "memory [MB]": _memory_mb(children[0].pid or 0),
    }  # fmt: skip
    for pipe in pipes:
        pipe.send(None)
    for child in children:
        child.join(10.0)
        child.kill()
    return figures


def _participant(number: int, nodes: int, all_nodes: int, pipe: Connection) -> None:
    """Be a participant until told to end; say whether it has seen all nodes."""
    rclpy.init()
    made = [rclpy.create_node(f"node_{k}", namespace=f"/robot_{number}") for k in range(nodes)]
    for node in made:
        node.create_publisher(JointState, f"{node.get_name()}/states", 10)
    end = time.monotonic() + PATIENCE_S
    while (seen := len(made[0].get_node_names())) < all_nodes and time.monotonic() < end:
        time.sleep(LOOK_S)
    pipe.send(seen >= all_nodes)
    pipe.recv()
    os._exit(0)


def _loopback_bytes() -> int:
    lines = [line for line in Path("/proc/net/dev").read_text().splitlines() if line.strip().startswith("lo:")]
    return int(lines[0].split(":")[1].split()[0])


def _memory_mb(pid: int) -> float:
    """Memory of a process that no other one shares, in MB."""
    rows = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
    return sum(int(rows[name].split()[0]) for name in ("Private_Clean", "Private_Dirty")) / 1024.0


if __name__ == "__main__":
    main()
