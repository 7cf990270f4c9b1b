"""What this computer needs for joint_id, and what of it is missing.

Packages beside the core add checks through the entry-point group `joint_id.checks`: functions without arguments that
return a list of `Check`.
"""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path

from joint_id_core.errors import JointIdError

GROUP = "joint_id.checks"
OLDEST_PYTHON = (3, 11)
NEEDED = ("numpy", "scipy", "sympy", "numba", "yaml", "rosbags", "mcap", "typer")
OPTIONAL = {
    "matplotlib": "pictures (--plot)",
    "pinocchio": "robot descriptions (--urdf)",
    "torch": "the estimator hpinn",
}
PACKAGES = {"yaml": "pyyaml", "pinocchio": "pin"}  # where the name on the package index is another one
LEAST_FREE = 1e8  # bytes


@dataclass(frozen=True)
class Check:
    """One finding.

    Attributes:
        name: what was looked at.
        fine: whether it is as it should be.
        text: what was found.
        mend: what to do, best as a command; empty if nothing is to be done.
        needed: False for what joint_id can do without.
    """

    name: str
    fine: bool
    text: str
    mend: str = ""
    needed: bool = True


def checks(robot: str = "", port: int = 0) -> Iterator[Check]:
    """Look at Python, libraries, the kernels' cache, what other packages check, and a robot if one is named."""
    yield _python()
    yield from (_library(name) for name in NEEDED)
    yield from (_library(name, use) for name, use in OPTIONAL.items())
    yield _cache()
    yield _compiles()
    others = entry_points(group=GROUP)
    if not others:
        yield Check(
            "ROS 2", False, "the nodes (joint_id_ros) are not installed; library and command line work without them",
            "make setup, or colcon build in ros2_ws, and source its setup.bash", needed=False,
        )  # fmt: skip
    for entry in others:
        try:
            yield from _listed(entry.load())
        except ImportError as error:
            yield Check(
                "ROS 2", False, f"{entry.value} does not load: {error}",
                "source /opt/ros/jazzy/setup.bash and ros2_ws/install/setup.bash", needed=False,
            )  # fmt: skip
    if robot:
        yield _robot(robot, port)


def _listed(found: Callable[[], list[Check]]) -> list[Check]:
    return found()


def _python() -> Check:
    found = platform.python_version()
    wanted = ".".join(map(str, OLDEST_PYTHON))
    fine = sys.version_info >= OLDEST_PYTHON
    return Check(
        "Python", fine, f"{found} on {platform.machine()}", "" if fine else f"install Python {wanted} or later"
    )


def _library(name: str, use: str = "") -> Check:
    package = PACKAGES.get(name, name)
    try:
        import_module(name)
    except ImportError as error:
        why = f"cannot be loaded ({error})" + (f"; only for {use}" if use else "")
        return Check(package, False, why, f"{Path(sys.executable).name} -m pip install {package}", needed=not use)
    try:
        return Check(package, True, version(package))
    except PackageNotFoundError:
        return Check(package, True, "there")


def _cache() -> Check:
    from joint_id_core.cell.module_cache import cache_directory

    place, mend = cache_directory(), "set JOINT_ID_CACHE_DIR to a folder that can be written, on a disk with space"
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=place) as file:
            file.write(b"0" * 1000)
        state = os.statvfs(place)
    except OSError as error:
        return Check("kernel cache", False, f"{place} cannot be written: {error.strerror}", mend)
    free = state.f_bavail * state.f_frsize
    kernels = len({path.parent for path in place.glob("*/*.py")})
    return Check("kernel cache", free > LEAST_FREE, f"{place}: {kernels} kernels, {free / 1e9:.1f} GB free", mend)


def _compiles() -> Check:
    from joint_id_core.cell.kernel import compile_model, is_compiled
    from joint_id_core.models import build

    model = build("rigid_joint")
    begun = time.perf_counter()
    try:
        known = is_compiled(model)
        compile_model(model)
    except (JointIdError, OSError) as error:
        return Check("kernels", False, str(error), "mend the cache first, see above")
    except Exception as error:  # whatever a compiler that does not fit its libraries may raise
        text = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        return Check("kernels", False, text, "install numba anew: pip install --force-reinstall numba")
    return Check(
        "kernels", True, f"rigid_joint {'loaded' if known else 'compiled'} in {time.perf_counter() - begun:.1f} s"
    )


def _robot(host: str, port: int) -> Check:
    from joint_id_core.rtde.client import Request
    from joint_id_core.rtde.clients import CLIENTS
    from joint_id_core.rtde.errors import RobotError
    from joint_id_core.rtde.fields import PORT

    client = CLIENTS["socket"](Request(host, ("timestamp", "actual_q"), port=port or PORT))
    try:
        client.open()
    except RobotError as error:
        mend = f"check power, network cable and address: ping {host}; RTDE is at port {port or PORT}"
        return Check("robot", False, str(error), mend)
    finally:
        client.close()
    return Check("robot", True, f"{host}: controller {'.'.join(map(str, client.version))} answers")


def table(found: list[Check]) -> str:
    """Return the findings as lines of text, each with what to do below."""
    width = max(len(c.name) for c in found) + 2
    lines = []
    for c in found:
        mark = "ok" if c.fine else ("wrong" if c.needed else "missing")
        lines.append(f"  {mark:<9}{c.name:<{width}}{c.text}")
        if not c.fine and c.mend:
            lines.append(f"  {'':<9}{'':<{width}}-> {c.mend}")
    return "\n".join(lines)
