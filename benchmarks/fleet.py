"""What a fleet of live robots costs, and how many two cores carry: writes its tables into docs/fleet.md.

    setup/run python benchmarks/fleet.py --docs

Sections: `robots` (driver, filter and identifier of robots with six joints at 125 Hz, in one process, in two, and in
one a node), `emulator` (the emulated robot), `page` (the page of all robots), `participants` (discovery). Processor
time is that of the processes themselves, so that other programs on the computer matter little; only whether samples
are lost depends on a quiet one.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cpu_time import cpu_s
from fleet_robots import RATE
from fleet_run import HOP_S, Watcher, memory_mb, running_fleet, watching
from graph import DOMAIN, JOINTS, node
from measured_blocks import write

from joint_id_core.emulator.process import EmulatorProcess

LAYOUTS = {"one process": 1, "two processes": 2, "a process a node": 0}
SPARE_S = 240.0  # of motion beyond what is measured: nodes take long to start on a busy computer
SECTIONS = ("robots", "emulator", "page", "participants")
HERE = Path(__file__).resolve().parent
SERVER = "127.0.0.1:11811"
# What the participants under test see of the network and of shared memory is theirs alone, where that is allowed.
ALONE = ["unshare", "-n", "-m", "sh", "-c", 'mount -t tmpfs none /dev/shm && ip link set lo up && exec "$@"', "sh"]


def main() -> None:
    """Run the sections and print what comes out."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=SECTIONS, help="(default: all)")
    parser.add_argument("--robots", nargs="+", type=int, default=[1, 5, 10, 20], help="(default: 1 5 10 20)")
    parser.add_argument("--layouts", nargs="+", choices=LAYOUTS, default=list(LAYOUTS), help="(default: all)")
    parser.add_argument("--participants", nargs="+", type=int, default=[10, 20, 40, 80], help="(default: 10 20 40 80)")
    parser.add_argument("--after", type=float, default=25.0, help="s of motion before it is measured (default: 25)")
    parser.add_argument("--duration", type=float, default=20.0, help="s that are measured (default: 20)")
    parser.add_argument("--json", type=Path, default=Path("out/benchmarks/fleet.json"), help="(default: %(default)s)")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/fleet.md")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    found: dict[str, list[dict[str, Any]]] = json.loads(args.json.read_text()) if args.json.exists() else {}
    args.json.parent.mkdir(parents=True, exist_ok=True)
    for section in args.sections:
        found[section] = []
        for row in _SECTIONS[section](args):
            found[section].append(row)
            print("  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
            args.json.write_text(json.dumps(found, indent=1))
    if args.docs:
        write("fleet.md", {f"fleet-{name}": _TABLES[name](rows) for name, rows in found.items()})


# --- robots


def _robots(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    for layout in args.layouts:
        for count in args.robots:
            if layout == "a process a node" and count > 5:
                continue  # a process each takes 130 MB
            with running_fleet(count, LAYOUTS[layout], args.after, args.duration + SPARE_S) as running:
                yield {"layout": layout, "robots": count, **_measured(*running, args.duration)}


def _measured(watcher: Watcher, processes: dict[str, list[int]], source: int, duration: float) -> dict[str, Any]:
    pids = [(kind, pid) for kind, some in processes.items() for pid in some]
    before, counts = {pid: cpu_s(pid) for _, pid in [*pids, ("", source)]}, watcher.counts()
    begun, watcher.lag_s = time.monotonic(), 0.0
    watcher.spin_for(duration)
    took, after = time.monotonic() - begun, watcher.counts()
    robots = len(watcher.identifiers)
    row: dict[str, Any] = {"load": os.getloadavg()[0]}
    for kind, some in processes.items():
        share = sum(cpu_s(pid) - before[pid] for pid in some) / took
        row[f"{kind} [% a robot]"] = 100.0 * share / robots
    row["source [%]"] = 100.0 * (cpu_s(source) - before[source]) / took
    row["memory [MB]"] = sum(memory_mb(pid) for _, pid in pids)
    row["samples a robot"] = (after["samples"] - counts["samples"]) / took / robots
    row["lost"] = after["lost"] - counts["lost"]
    row["estimates"] = (after["fits"] - counts["fits"]) / took / (robots * len(JOINTS) / HOP_S)
    row["lag [s]"] = watcher.lag_s
    row["converged"] = watcher.converged / (robots * len(JOINTS))
    return row


def _robots_table(rows: list[dict[str, Any]]) -> str:
    head = ["processes", "robots", "of a core a robot", "all", "memory", "samples a second and robot", "lost",
            "estimates that came", "longest lag", "converged", "load"]  # fmt: skip
    lines = []
    for r in rows:
        kinds = {k.split(" [")[0]: v for k, v in r.items() if k.endswith("[% a robot]")}
        share = sum(kinds.values())
        parts = "" if len(kinds) == 1 else f" ({', '.join(f'{k} {v:.1f}' for k, v in kinds.items())})"
        lines.append([
            r["layout"], str(r["robots"]), f"{share:.1f} %{parts}", f"{share * r['robots']:.0f} %",
            f"{r['memory [MB]']:.0f} MB", f"{r['samples a robot']:.1f}", str(r["lost"]),
            f"{100 * r['estimates']:.0f} %",
            f"{r['lag [s]']:.2f} s", f"{100 * r['converged']:.0f} %", f"{r['load']:.0f}",
        ])  # fmt: skip
    return _table(head, lines)


# --- emulator and page


def _emulator(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    with EmulatorProcess("--host", "127.0.0.1") as emulator, watching() as watcher:
        given = {"robot_ip": emulator.host, "port": emulator.port, "rate": float(RATE)}
        with node("driver", given) as driver:
            watcher.spin_for(5.0)
            before = cpu_s(emulator.process.pid), cpu_s(driver.pid)
            watcher.spin_for(args.duration)
            shares = [
                (cpu_s(p) - b) / args.duration for p, b in zip((emulator.process.pid, driver.pid), before, strict=True)
            ]
    yield {"emulator [%]": 100.0 * shares[0], "driver [%]": 100.0 * shares[1], "load": os.getloadavg()[0]}


def _emulator_table(rows: list[dict[str, Any]]) -> str:
    (r,) = rows
    lines = [
        ["emulated robot, read at 125 Hz", f"{r['emulator [%]']:.0f} %"],
        ["its driver", f"{r['driver [%]']:.1f} %"],
    ]
    return _table(["process", "of a core"], lines)


def _page(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    for count in args.robots:
        with (
            running_fleet(count, 2, args.after, 2.0 * args.duration + SPARE_S) as (watcher, _, _),
            node("watch_fleet", {"port": 8799}) as page,
        ):
            watcher.spin_for(10.0)
            before = cpu_s(page.pid)
            watcher.spin_for(args.duration)
            closed = (cpu_s(page.pid) - before) / args.duration
            connection = http.client.HTTPConnection("127.0.0.1", 8799, timeout=30.0)
            connection.request("GET", "/events")
            answer, sizes, before = connection.getresponse(), [], cpu_s(page.pid)
            end = time.monotonic() + args.duration
            while time.monotonic() < end:
                sizes.append(len(answer.readline()))
            opened = (cpu_s(page.pid) - before) / args.duration
            yield {
                "robots": count, "bytes": max(sizes), "closed [%]": 100.0 * closed, "open [%]": 100.0 * opened,
                "memory [MB]": memory_mb(page.pid), "load": os.getloadavg()[0],
            }  # fmt: skip


def _page_table(rows: list[dict[str, Any]]) -> str:
    head = ["robots", "an update, once a second", "of a core", "while a page is open", "memory"]
    return _table(head, [
        [str(r["robots"]), f"{r['bytes'] / 1000:.1f} kB", f"{r['closed [%]']:.1f} %", f"{r['open [%]']:.1f} %",
         f"{r['memory [MB]']:.0f} MB"]
        for r in rows
    ])  # fmt: skip


# --- participants


def _participants(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    own = ALONE if subprocess.run([*ALONE, "true"], capture_output=True, check=False).returncode == 0 else []
    server = shutil.which("fast-discovery-server")
    for count in args.participants:
        yield {"how": "a participant a node", **_figures(own, [], count, 1)}
        yield {"how": "a participant for three nodes", **_figures(own, [], max(1, count // 3), 3)}
        if server:
            yield {"how": "with a discovery server", **_figures(own, [server], count, 1)}
        yield {"how": "one participant for all", **_figures(own, [], 1, count)}


def _figures(own: list[str], server: list[str], participants: int, nodes: int) -> dict[str, Any]:
    given = ["--participants", str(participants), "--nodes", str(nodes)]
    command = [sys.executable, str(HERE / "fleet_participants.py"), *given]
    environment = os.environ.copy()
    if server:
        host, _, port = SERVER.partition(":")
        started = f"{server[0]} -i 0 -l {host} -p {port} >/dev/null 2>&1 & s=$!; sleep 2; "
        command = ["sh", "-c", started + '"$@"; r=$?; kill $s; exit $r', "sh", *command]
        environment["ROS_DISCOVERY_SERVER"] = SERVER
    done = subprocess.run(
        [*own, *command], env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout.decode().splitlines()[-1])
    return found


def _participants_table(rows: list[dict[str, Any]]) -> str:
    head = ["nodes", "how", "participants", "all see all after", "processor time until then", "sent until then",
            "sent afterwards", "of a core afterwards"]  # fmt: skip
    return _table(head, [
        [str(r["nodes"]), r["how"], str(r["participants"]), _seen(r), f"{r['cpu to match [s]']:.1f} s",
         f"{r['bytes to match'] / 1e6:.1f} MB", f"{r['steady [bytes/s]'] / 1e3:.0f} kB/s",
         f"{r['steady [% of a core]']:.0f} %"]
        for r in rows
    ])  # fmt: skip


def _seen(row: Mapping[str, Any]) -> str:
    if row["complete"] < row["participants"]:
        return f"only {row['complete']:.0f} do"
    return f"{row['match [s]']:.0f} s"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


_SECTIONS: dict[str, Callable[[argparse.Namespace], Iterator[dict[str, Any]]]] = {
    "robots": _robots, "emulator": _emulator, "page": _page, "participants": _participants,
}  # fmt: skip
_TABLES: dict[str, Callable[[list[dict[str, Any]]], str]] = {
    "robots": _robots_table, "emulator": _emulator_table, "page": _page_table, "participants": _participants_table,
}  # fmt: skip

if __name__ == "__main__":
    main()
