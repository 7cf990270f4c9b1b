"""Every command and Python block of the pages is run as written, in order, or the page says why it is not.

A comment on the line before a block says why: `<!-- not run: REASON -->`, or `<!-- ros2 not run: REASON -->` for its
commands that begin with ros2; in reStructuredText, `.. not run: REASON`. A page is run in a folder of its own, in which
the recordings that it names are simulated (`doc_recordings.py`).
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from doc_recordings import RECORDINGS
from page_blocks import PAGES, ROOT, RST, blocks, named

PATIENCE_S = 300.0  # a limit for commands that hang
LANGUAGES = {"sh", "python", "text", "xml", "math", "mermaid", ""}

# What is not run as it is written: text, what is run instead, why.
SUBSTITUTIONS = (
    ("joint-id robot-emulator ", "joint-id robot-emulator --port 0 ", "test runs go side by side"),
    ("joint-id watch", "joint-id watch --port 0", "the same"),
    ("port:=8080", "port:=0", "the same"),
    ("robot_ip:=127.0.0.1", "robot_ip:=127.0.0.1 -p port:={port}", "the emulated robot of the test"),
    ("duration:=10.0", "duration:=1.0", "shorter"),
    ("--duration 30", "--duration 6", "shorter; discovery takes seconds on a busy machine"),
)
# Commands that run until they are stopped: nodes with their name in /diagnostics, and what another prints when ready.
NODES = {
    f"joint-id-{name.replace('_', '-')}": name
    for name in (
        "arm_identifier",
        "filter",
        "identifier",
        "driver",
        "sim",
        "watch",
        "watch_fleet",
        "identify",
        "emulated_motion",
    )
}
PRINTS = {"joint-id robot-emulator": "ready on ", "joint-id watch": "the page is at"}
# What has to run beside the commands of a page, since the page says so in words.
BESIDE = {
    "docs/nodes/player.md": ("joint-id-filter --ros-args -p use_sim_time:=true",),
    "docs/tutorials/live.md": ("joint-id-sim --ros-args -p model:=harmonic_drive",),
}
# Pages whose Python is run by another test, which also looks at what comes out.
PYTHON_ELSEWHERE = {
    "docs/tutorials/extend.md": "test_docs.py::test_the_tutorial_model_identifies_its_truth",
    "docs/tutorials/live.md": "test_the_subscriber_of_the_tutorial_prints_estimates",
}


class Page:
    """A page that is run: commands one after the other, with the variables that they set."""

    def __init__(self, page: Path, folder: Path, probe: Any) -> None:
        self.folder, self._probe, self._set = folder, probe, list[str]()
        self._path = named(page)
        self._running: list[tuple[str, subprocess.Popen[bytes], Path]] = []
        self._environment = {
            **os.environ,
            "PATH": f"{ROOT}/.venv/bin:{os.environ['PATH']}",
            "MPLBACKEND": "agg",
        }
        for name in (".venv", "bags", "config", "docs", "setup"):
            (folder / name).symlink_to(ROOT / name)

    def run(self, command: str, port: int = 0) -> None:
        """Run a command as a reader would, in the terminal of the others or, if it stays, in one of its own."""
        for text, instead, _ in SUBSTITUTIONS:
            command = command.replace(text, instead.format(port=port))
        if re.match(r"(export )?\w+=\S+$", command):
            self._set.append(command)
            return
        words = shlex.split(command)
        program = " ".join([Path(words[0]).name, *words[1:2]])
        stays = next((name for name in (*NODES, *PRINTS) if program in (name, f"{name} --ros-args")), "")
        if stays and "duration:=" not in command:
            self._start(command, stays)
            return
        output = self.folder / "output.txt"
        with output.open("w") as file:
            done = subprocess.run(
                ["bash", "-c", "\n".join([*self._set, command])], cwd=self.folder, env=self._environment,
                stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, timeout=PATIENCE_S,
            )  # fmt: skip
        assert done.returncode == 0, f"{self._path}: {command}\nended with {done.returncode}:\n{output.read_text()}"

    def _start(self, command: str, stays: str) -> None:
        """Start a command that stays, and wait until it is at work."""
        output = self.folder / f"output_{len(self._running)}.txt"
        with output.open("w") as file:
            process = subprocess.Popen(
                ["bash", "-c", "\n".join([*self._set, f"exec {command}"])], cwd=self.folder, env=self._environment,
                stdout=file, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        self._running.append((command, process, output))
        self._probe.until(
            lambda: (
                process.poll() is not None
                or (stays in NODES and self._probe.told(NODES[stays], ""))
                or (stays in PRINTS and PRINTS[stays] in output.read_text())
            ),
            command,
        )
        assert process.poll() is None, f"{self._path}: {command}\nended at once:\n{output.read_text()}"

    def stop(self) -> None:
        """End what still runs, as Ctrl-C does: it must have nothing to complain of."""
        ended = []
        for command, process, output in reversed(self._running):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                ended.append((command, process.wait(30.0), output.read_text()))
            except subprocess.TimeoutExpired:
                process.kill()
                ended.append((command, process.wait(), output.read_text()))
        self._running = []
        assert [e for e in ended if e[1] != 0] == []


@pytest.fixture
def opened(tmp_path: Path, probe: Any) -> Iterator[Callable[[Path], Page]]:
    """Open a page for running."""
    pages: list[Page] = []

    def begin(page: Path) -> Page:
        pages.append(Page(page, tmp_path, probe))
        return pages[-1]

    yield begin
    for page in pages:
        page.stop()


def runnable(page: Path) -> list[tuple[str, str]]:
    """Language and text of the commands and Python blocks of a page that are to be run, in order.

    Its Python blocks are one program, as in a notebook, that stands where the last of them does.
    """
    found, program = [], ""
    for block in blocks(page):
        if block.language == "sh":
            found += [("sh", command) for command in block.commands if not block.excuses(command)]
        elif block.language == "python" and named(page) not in PYTHON_ELSEWHERE and not block.reason:
            found = [item for item in found if item[0] != "python"]
            program += block.body
            found.append(("python", program))
    return found


# What a new user types first; the other pages take minutes together.
QUICK = ("README.md",)
RUN = [
    pytest.param(page, id=named(page), marks=() if named(page) in QUICK else pytest.mark.long)
    for page in (*PAGES, *RST)
    if runnable(page)
]


@pytest.mark.parametrize("page", RUN)
def test_commands_run_as_written(page: Path, opened: Callable[[Path], Page], robot: Callable[..., Any]) -> None:
    run, path = opened(page), named(page)
    for record in RECORDINGS.get(path, ()):
        record(run.folder)
    commands = runnable(page)
    port = robot().port if any("robot_ip:=127.0.0.1" in text for _, text in commands) else 0
    for command in BESIDE.get(path, ()):
        run.run(command)
    for language, text in commands:
        if language == "python":
            (run.folder / "blocks.py").write_text(text)
            run.run(f"{shlex.quote(sys.executable)} blocks.py")
        else:
            run.run(text, port)
    run.stop()


@pytest.mark.parametrize("page", [*PAGES, *RST], ids=named)
def test_blocks_have_a_language_and_commands_of_ros_are_marked(page: Path) -> None:
    text = page.read_text()
    found = blocks(page)
    begun = text.count("code-block::") if page.suffix == ".rst" else text.count("```") / 2
    assert begun == len(found), "a block that is not understood"
    assert {block.language for block in found} <= LANGUAGES
    for block in found:
        assert not (block.reason and block.language not in ("sh", "python")), block.body
        if block.language == "sh":
            for command in block.commands:
                needs_ros = shlex.split(command)[0] in ("ros2", "rosdep", "colcon")
                assert block.excuses(command) or not needs_ros, f"{command}: say that it is not run"
    comments = re.findall(r"^\.\. (.*)$" if page.suffix == ".rst" else r"<!-- (.*?) -->", text, re.MULTILINE)
    marks = [c for c in comments if "not run" in c]
    assert len(marks) == sum(bool(block.reason) for block in found), f"a mark that stands before no block: {marks}"


def test_every_substitution_and_exception_is_still_needed() -> None:
    commands = [text for page in PAGES for _, text in runnable(page)]
    for text, _, _ in SUBSTITUTIONS:
        assert any(text in command for command in commands), text
    assert {*RECORDINGS, *BESIDE, *PYTHON_ELSEWHERE} <= set(map(named, PAGES))


def test_a_command_that_fails_is_noticed(opened: Callable[[Path], Page]) -> None:
    run = opened(ROOT / "README.md")
    with pytest.raises(AssertionError, match="ended with 2"):
        run.run("joint-id info missing.csv")
    with pytest.raises(AssertionError, match="ended at once"):
        run.run("joint-id-filter --ros-args -r link_states:=/joint_states")
    run._running.clear()


def test_the_subscriber_of_the_tutorial_prints_estimates(tmp_path: Path, probe: Any) -> None:
    """The Python of docs/tutorials/live.md, which runs until it is stopped."""
    from rclpy.qos import DurabilityPolicy, QoSProfile

    from joint_id_msgs.msg import JointEstimate, JointParams, ParameterEstimate

    (python,) = (b.body for b in blocks(ROOT / "docs/tutorials/live.md") if b.language == "python")
    parameter = ParameterEstimate(name="k_1", value=8000.0, std_dev=5.0, verdict=ParameterEstimate.ESTIMATED)
    joint = JointEstimate(joint="elbow", parameters_status=JointEstimate.CONVERGED, age=0.5, parameters=[parameter])
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = probe.create_publisher(JointParams, "joint_params", qos)
    publisher.publish(JointParams(joints=[joint]))
    process = subprocess.Popen([sys.executable, "-u", "-c", python], stdout=(tmp_path / "printed.txt").open("w"))
    try:
        printed = tmp_path / "printed.txt"
        probe.until(lambda: printed.read_text() or process.poll() is not None, "an estimate on the screen")
        assert printed.read_text() == "elbow 0.5 {'k_1': (8000.0, 5.0)}\n"
    finally:
        process.kill()
        process.wait()
