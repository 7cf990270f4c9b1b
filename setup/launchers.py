"""Write the workspace's environment to a file, and a launcher for each console script into the virtual environment.

The library is made known to its Python, too.

setup/build.sh runs this once, inside the sourced workspace. Sourcing takes a second; loading the file takes no time.
"""

from __future__ import annotations

import os
import shlex
import sys
import sysconfig
from pathlib import Path

BEGIN = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); import runpy; sys.argv = sys.argv[1:]; "
    "runpy.run_path(sys.argv[0], run_name='__main__')"
)
MARK = "# launcher of joint_id, written by make setup"


def environment(venv: Path) -> str:
    """Shell commands that set what the sourced workspace has set; they do not depend on the caller's shell."""
    own = {name: os.environ[name] for name in ("AMENT_PREFIX_PATH", "PYTHONPATH")}
    own |= {
        "VIRTUAL_ENV": str(venv),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",  # the only one that the wheels have
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",  # LD_LIBRARY_PATH is set below: the wheels need no second start
    }
    lines = [MARK] + [f"export {name}={shlex.quote(value)}" for name, value in own.items()]
    for name, value in (("PATH", f"{venv}/bin"), ("LD_LIBRARY_PATH", os.environ["LD_LIBRARY_PATH"])):
        lines.append(f'export {name}={shlex.quote(value)}"${{{name}:+:${name}}}"')
    return "\n".join(lines) + "\n"


def scripts(install: Path) -> dict[str, Path]:
    """Installed console scripts by the name of their launcher."""
    found = {p.name: p for p in sorted((install / "joint_id_core/lib/joint_id_core").glob("*")) if p.is_file()}
    nodes = sorted((install / "joint_id_ros/lib/joint_id_ros").glob("*"))
    return found | {f"joint-id-{p.name.replace('_', '-')}": p for p in nodes if p.is_file()}


def main(venv: Path, install: Path) -> None:
    """Write `<venv>/joint_id.env`, the path of the library, and launchers; remove those of scripts that are gone."""
    library = [path for path in os.environ["PYTHONPATH"].split(os.pathsep) if "joint_id_core" in path]
    Path(sysconfig.get_path("purelib"), "joint_id.pth").write_text("\n".join([*library, ""]))
    env_file = venv / "joint_id.env"
    env_file.write_text(environment(venv))
    targets = scripts(install)
    for old in (venv / "bin").glob("joint-id*"):
        if old.name not in targets and MARK in old.read_text(errors="replace"):
            old.unlink()
    # Ctrl-C while Python still imports ends the process as the system does it, without a traceback.
    python = f"{shlex.quote(str(venv / 'bin/python'))} -c {shlex.quote(BEGIN)}"
    for name, script in targets.items():
        launcher = venv / "bin" / name
        launcher.write_text(
            f'#!/bin/sh\n{MARK}\n. {shlex.quote(str(env_file))}\nexec {python} {shlex.quote(str(script))} "$@"\n'
        )
        launcher.chmod(0o755)
    print("commands:", " ".join(f".venv/bin/{name}" for name in targets))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
