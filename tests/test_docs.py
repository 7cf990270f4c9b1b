"""What README and docs say is what the code does: tables, links, commands, Python blocks."""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.util
import re
import sys
from itertools import chain, pairwise
from pathlib import Path
from types import ModuleType
from unittest.mock import MagicMock

import pytest
import yaml
from page_blocks import FENCE, PAGES, ROOT, RST, bodies, command_lines, named
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.results.estimate import Estimate

NODES = ROOT / "ros2_ws/src/joint_id_ros"
TOPICS = {"joint_params", "diagnostics", "joint_states"}  # that pages read with the tools of ROS
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def load_generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_generate", ROOT / "docs/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    """The script, which makes its tables once for all pages."""
    module = load_generator()
    module.tables = functools.cache(module.tables)  # type: ignore[attr-defined]
    return module


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
def test_every_node_parameter_is_declared_with_the_default_of_its_page(
    generator: ModuleType, node: str, domain: int
) -> None:
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


@pytest.mark.parametrize("page", [*PAGES, *RST], ids=named)
def test_commands_exist_with_the_options_that_are_shown(generator: ModuleType, page: Path) -> None:
    commands = generator.commands()
    for words in command_lines(page):
        program = Path(words[0]).name
        if program == "joint-id":
            shown = commands.get("-".join(words[1:3])) or commands[words[1]]
            known = set(chain.from_iterable([*p.opts, *p.secondary_opts] for p in shown.params))
            assert {w for w in words if w.startswith("--")} <= known, words
            models = [v for k, v in pairwise(words) if k == "--model"]
            assert set(models) <= set(generator.MODELS), words
        elif program == "make":
            assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), words
        elif words[:2] == ["ros2", "run"] or program.startswith("joint-id-"):
            node = words[3] if program == "ros2" else program.removeprefix("joint-id-").replace("-", "_")
            assert f'"{node} = joint_id_ros.' in (NODES / "setup.py").read_text(), words
            given = dict(v.split(":=", 1) for k, v in pairwise(words) if k == "-p")
            assert given.keys() <= parameters(generator, node), words
            for options in generator.NODES[node]:  # which check their values when they are made
                values = {n: yaml.safe_load(v) for n, v in given.items() if n in options.__dataclass_fields__}
                options(**{n: tuple(v) if isinstance(v, list) else v for n, v in values.items()})
        elif words[:2] == ["ros2", "launch"]:
            arguments = {a.name: a for a in generator.LAUNCH_FILES[words[3].removesuffix(".launch.py")].arguments}
            given = dict(argument.split(":=", 1) for argument in words[4:])
            assert given.keys() <= arguments.keys(), words
            assert {name for name, a in arguments.items() if a.default is None} <= given.keys(), words
            assert all(value in arguments[name].choices or not arguments[name].choices for name, value in given.items())
        elif words[:2] == ["ros2", "param"]:
            verb, node, name, value = words[2:]
            assert verb == "set", words
            taking = [o for o in generator.NODES[node.lstrip("/")] if name in o.__dataclass_fields__]
            assert taking, f"{node} has no parameter {name}"
            given_value = yaml.safe_load(value)
            taking[0](**{name: tuple(given_value) if isinstance(given_value, list) else given_value})
        elif words[:2] == ["ros2", "service"]:
            verb, service, kind = words[2:]
            _, node, name = service.split("/")
            assert verb == "call" and services(ROOT / f"docs/nodes/{node}.md")[f"~/{name}"] == kind, words
        elif words[:2] in (["ros2", "topic"], ["ros2", "bag"]):
            assert words[2] in ("echo", "record"), words
            assert {w for w in words if w.startswith("-")} <= {"-o", "--qos-durability", "--qos-reliability"}, words
            # a publisher that is gone leaves its last message only to those who ask for both
            assert ("--qos-durability" in words) == ("--qos-reliability" in words), words
            topics = {w.lstrip("/") for w in words[3:] if w.startswith("/")}
            assert topics and topics <= TOPICS, words


@pytest.mark.parametrize("page", [*PAGES, *RST], ids=named)
def test_repository_files_that_commands_name_exist(page: Path) -> None:
    for word in chain.from_iterable(command_lines(page)):
        if re.match(r"(bags|config|docs|demo|setup)/", word):
            assert (ROOT / word).exists(), word


def services(page: Path) -> dict[str, str]:
    """Services that the page of a node names, with their types."""
    section = page.read_text().partition("\n## Services\n")[2].partition("\n## ")[0]
    return dict(re.findall(r"^\| `(~/\w+)` \| `([\w/]+)` \|", section, re.MULTILINE))


def test_the_identifier_has_the_services_of_its_page() -> None:
    pytest.importorskip("rclpy", reason="needs the built workspace")
    from joint_id_ros import baselines
    from joint_id_ros.knowledge_services import serve

    node = MagicMock()
    serve(node, MagicMock(), lambda: None)
    baselines.Baselines(node, MagicMock(), MagicMock())
    made = {name: kind for kind, name, _ in (call.args for call in node.create_service.call_args_list)}
    kinds = {name: f"{kind.__module__.partition('.')[0]}/srv/{kind.__name__}" for name, kind in made.items()}
    assert kinds == services(ROOT / "docs/nodes/identifier.md")


def public_places() -> set[tuple[str, str]]:
    """Modules and names that docs/python.md calls public beside the names of `joint_id_core` itself."""
    rows = re.findall(r"^\| `([\w.]+)`: (.+?) \|", (ROOT / "docs/python.md").read_text(), re.MULTILINE)
    return {(f"joint_id_core.{module}", name) for module, names in rows for name in re.findall(r"`(\w+)`", names)}


def test_what_pages_and_examples_import_from_the_library_is_public() -> None:
    programs = [text for page in PAGES for text in bodies(page, "python")]
    programs += [path.read_text() for path in (ROOT / "examples").glob("*.py")]
    statements = [n for text in programs for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)]
    used = {(n.module, a.name) for n in statements for a in n.names if (n.module or "").startswith("joint_id_core.")}
    assert used == public_places(), "docs/python.md names what pages and examples use, and no more"
    assert all(hasattr(importlib.import_module(module), name) for module, name in used)


def test_contributing_names_every_room_of_the_library() -> None:
    library = ROOT / "ros2_ws/src/joint_id_core/joint_id_core"
    rooms = {path.parent.name for path in library.glob("*/__init__.py")}
    section = (ROOT / "CONTRIBUTING.md").read_text().partition("The rooms of the library")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)) == rooms


def test_verdict_limits_in_the_text() -> None:
    from joint_id_core.estimators.innovations import verdicts

    page = (ROOT / "docs/tutorials/verdicts.md").read_text()
    assert f"ratio up to {verdicts.PRIOR_RATIO:g}" in page
    assert f"above {verdicts.NOT_EXCITED_RATIO:g}: this motion cannot" in page
    assert f"beyond {verdicts.COLOURED:g} in size" in page
    assert f"is then below {verdicts.MAGNITUDE:g})" in page


def test_options_of_a_candidate_in_the_text() -> None:
    from joint_id_core.models.options import DRIVES, FLAGS

    page = " ".join((ROOT / "docs/tutorials/compare.md").read_text().split())
    assert f"with the options {', '.join(f'`{name}`' for name in (*FLAGS, *DRIVES))}." in page


def test_the_tutorial_model_identifies_its_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (python,) = bodies(ROOT / "docs/tutorials/extend.md", "python")
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


def test_readme_tells_what_its_first_commands_print(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text()
    for words in (
        "simulate harmonic_drive --set k_1=8000 --set J_q=1.2 --out motion.csv",
        "fit motion.csv --model harmonic_drive --save motion.json",
    ):
        assert f"joint-id {words.removesuffix(' --save motion.json')}" in readme
        assert CliRunner().invoke(app, words.split()).exit_code == 0
    start = re.search(r"starts at `k_1` (\S+) and `J_q` (\S+)\.\s", readme)
    said = re.search(r"It ends at (\S+) ± (\S+) Nm/rad and (\S+) ± (\S+) kg", readme)
    assert start is not None and said is not None
    found = Estimate.load("motion.json")
    k_1, j_q = found["k_1"], found["J_q"]
    assert [k_1.initial, j_q.initial] == pytest.approx([float(start[1]), float(start[2])], rel=1e-3)
    assert [k_1.value, k_1.std_dev] == pytest.approx([float(said[1]), float(said[2])], abs=0.55)
    assert [j_q.value, j_q.std_dev] == pytest.approx([float(said[3]), float(said[4])], abs=6e-4)
