"""What README and docs say is what the code does: tables, links, commands, Python blocks."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from itertools import chain, pairwise
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NODES = ROOT / "ros2_ws/src/joint_id_ros"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def load_generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_generate", ROOT / "docs/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return load_generator()


def blocks(page: Path, language: str) -> list[str]:
    return [body for kind, body in FENCE.findall(page.read_text()) if kind == language]


def command_lines(page: Path) -> list[list[str]]:
    """Words of every command in the sh blocks, continuation lines joined."""
    text = "\n".join(blocks(page, "sh")).replace("\\\n", " ")
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    text = FENCE.sub("", page.read_text())
    titles = (
        re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    )
    return set(titles)


def parameters(generator: ModuleType, node: str) -> set[str]:
    """Names of the ROS parameters of a node."""
    return {f for cls in generator.NODES[node] for f in cls.__dataclass_fields__} | {"use_sim_time"}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_generated_tables_say_what_the_code_says(generator: ModuleType, page: Path) -> None:
    text = page.read_text()
    assert generator.rewrite(text) == text, "run: setup/run python docs/generate.py"


def test_everything_that_is_generated_stands_on_some_page(generator: ModuleType) -> None:
    placed = {name for page in PAGES for _, name, _ in generator.BLOCK.findall(page.read_text())}
    assert placed == set(generator.tables())


def test_a_wrong_table_is_noticed(generator: ModuleType) -> None:
    page = (ROOT / "docs/nodes/filter.md").read_text()
    assert "`50.0`" in page
    assert generator.rewrite(page.replace("`50.0`", "`40.0`")) == page


@pytest.mark.parametrize("node", ["sim", "filter", "identifier", "player", "driver"])
def test_every_node_parameter_is_declared_with_the_default_of_its_page(generator: ModuleType, node: str) -> None:
    rclpy = pytest.importorskip("rclpy", reason="needs the built workspace")
    from joint_id_ros.parameters import declare

    context = rclpy.context.Context()
    rclpy.init(context=context)
    try:
        ros = rclpy.create_node("documented", context=context)
        for options in generator.NODES[node]:
            declare(ros, options)
        rows = re.findall(r"^\| `(\w+)` \| (\S.*?) \| ", (ROOT / f"docs/nodes/{node}.md").read_text(), re.MULTILINE)
        documented = {name: default for name, default in rows if name in parameters(generator, node)}
        assert documented.keys() == parameters(generator, node) - {"use_sim_time"}
        for name, default in documented.items():
            value = ros.get_parameter(name).value
            value = tuple(v for v in value if v != "") if isinstance(value, list) else value
            assert generator.shown(value) == default, name
        ros.destroy_node()
    finally:
        context.try_shutdown()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(FENCE.sub("", page.read_text())):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{target}: no such file"
        if anchor:
            assert anchor in anchors(there), f"{target}: no such heading"


def test_every_page_is_reached_from_the_readme() -> None:
    seen, waiting = set(), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in seen or page.suffix != ".md":
            continue
        seen.add(page)
        targets = (t.partition("#")[0] for t in LINK.findall(page.read_text()) if "://" not in t)
        waiting += [(page.parent / t).resolve() for t in targets if t]
    assert seen >= set(PAGES)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_exist_with_the_options_that_are_shown(generator: ModuleType, page: Path) -> None:
    commands = generator.commands()
    for words in command_lines(page):
        program = Path(words[0]).name
        if program == "joint-id":
            shown = commands[words[1]]
            known = set(chain.from_iterable([*p.opts, *p.secondary_opts] for p in shown.params))
            assert {w for w in words if w.startswith("--")} <= known, words
            models = [v for k, v in pairwise(words) if k == "--model"]
            assert set(models) <= set(generator.MODELS), words
        elif program == "make":
            assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), words
        elif words[:2] == ["ros2", "run"] or program.startswith("joint-id-"):
            node = words[3] if program == "ros2" else program.removeprefix("joint-id-")
            assert f'"{node} = joint_id_ros.' in (NODES / "setup.py").read_text(), words
            given = {v.partition(":=")[0] for k, v in pairwise(words) if k == "-p"}
            assert given <= parameters(generator, node), words
        elif words[:2] == ["ros2", "launch"]:
            arguments = {a.name: a for a in generator.LAUNCH_FILES[words[3].removesuffix(".launch.py")].arguments}
            given = dict(argument.split(":=", 1) for argument in words[4:])
            assert given.keys() <= arguments.keys(), words
            assert {name for name, a in arguments.items() if a.default is None} <= given.keys(), words
            assert all(value in arguments[name].choices or not arguments[name].choices for name, value in given.items())


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_repository_files_that_commands_name_exist(page: Path) -> None:
    for word in chain.from_iterable(command_lines(page)):
        if re.match(r"(bags|config|docs|demo|setup)/", word):
            assert (ROOT / word).exists(), word


def test_exit_codes_statuses_and_constants_in_the_text() -> None:
    from joint_id_core.estimators.innovations import annealing
    from joint_id_core.estimators.innovations import options as innovations_options
    from joint_id_core.estimators.innovations import verdicts as identifiability
    from joint_id_core.estimators.innovations import whiteness as memory
    from joint_id_core.models import RigidJoint, dc_motor, transmission

    verdicts = (ROOT / "docs/tutorials/verdicts.md").read_text()
    theory = (ROOT / "docs/theory.md").read_text()
    assert f"ratio up to {identifiability.PRIOR_RATIO:g}" in verdicts
    assert f"above {identifiability.NOT_EXCITED_RATIO:g}: this motion cannot" in verdicts
    assert f"beyond {identifiability.COLOURED:g} in size" in verdicts
    assert f"| $N$ | {transmission.GEAR_RATIO:g} |" in theory
    assert f"| $L$ | {dc_motor.INDUCTANCE:.0e}".replace("e-0", "e-") in theory
    assert f"for `rigid_joint` {100 * RigidJoint.smoothing_share:g} % of the\npeak speed" in theory
    assert f"at most {innovations_options.MAX_SUBSTEPS}." in theory
    assert (annealing.STRONG, annealing.STRONGEST) == (1e4, 1e6)
    assert "$q$ starts at 1e4 times" in theory and "$q$ held at 1e6 times" in theory
    assert (annealing.EXCERPT, annealing.SHORTEST) == (4, 250) and "at least 250 samples long" in theory
    assert (memory.LAGS, memory.RARE) == (30, 1e-4) and "over 30 lags; where its probability is below 1e-4" in theory


def test_the_readme_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands and the Python lines of the section Use, as they stand."""
    from joint_id_core import cli

    section = (ROOT / "README.md").read_text().split("\n## Use\n")[1].split("\n## ")[0]
    (shell,) = (body for kind, body in FENCE.findall(section) if kind == "sh")
    (python,) = (body for kind, body in FENCE.findall(section) if kind == "python")
    monkeypatch.chdir(tmp_path)
    lines = [words[1:] for line in shell.splitlines() if (words := shlex.split(line))[0] == "joint-id"]
    assert lines
    for words in lines:
        monkeypatch.setattr(sys, "argv", ["joint-id", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0, words
    scope: dict[str, object] = {}
    exec(compile(python, "README.md", "exec"), scope)
    assert scope["estimate"].converged  # type: ignore[attr-defined]  # an Estimate


def test_the_tutorial_model_identifies_its_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (python,) = blocks(ROOT / "docs/tutorials/extend.md", "python")
    path = tmp_path / "tutorial_drag.py"
    path.write_text(python)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, path.stem, module)
    spec.loader.exec_module(module)
    assert module.estimate.converged
    for name in ("J", "c_2"):
        assert module.estimate[name].value == pytest.approx(module.truth[name], rel=0.01)
