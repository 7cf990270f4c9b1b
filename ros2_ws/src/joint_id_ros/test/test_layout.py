"""Nodes stand on what helps them, and that stands on the options; nothing imports from above itself."""

from __future__ import annotations

import ast
from pathlib import Path

import joint_id_ros

ROOT = Path(joint_id_ros.__file__).parent
FLOORS = ("options", "helpers", "nodes")  # from the ground up; a file in no folder is a helper
STARTER = "running.py"  # loads the node to run by its name


def floor_of(module: str) -> int:
    """The floor of a module of this package, by its name without that of the package."""
    folder = module.split(".")[0]
    return FLOORS.index(folder if folder in FLOORS else "helpers")


def named(file: Path) -> set[str]:
    """Modules of this package that a file imports or names in a text, without the name of the package."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, f"{file}, line {node.lineno}: write the whole name of the module"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value)  # perhaps for import_module
    inside = f"{ROOT.name}."
    return {name.removeprefix(inside) for name in names if name.startswith(inside)}


def test_arrows_run_down_only() -> None:
    up = {
        str(file.relative_to(ROOT)): sorted(above)
        for file in sorted(ROOT.rglob("*.py"))
        if (above := {m for m in named(file) if floor_of(m) > floor_of(file.relative_to(ROOT).parts[0])})
    }
    assert up == {STARTER: ["nodes."]}


def test_nodes_do_not_import_each_other() -> None:
    nodes = (ROOT / "nodes").glob("*.py")
    assert not [f"{file.name}: {module}" for file in nodes for module in named(file) if module.startswith("nodes")]
