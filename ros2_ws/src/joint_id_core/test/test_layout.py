"""The rooms of the library stand in floors: a room imports only from rooms below it."""

from __future__ import annotations

import ast
from pathlib import Path

import joint_id_core

ROOT = Path(joint_id_core.__file__).parent
# From the ground up; what stands on one line does not import from each other.
FLOORS = (
    ("errors",),
    ("options", "assignments"),
    ("data",),
    ("models", "formats", "filtering", "rtde"),
    ("cell", "simulation", "results", "alignment"),
    ("estimators.shared",),
    ("estimators.innovations", "estimators.hpinn"),
    ("estimators",),
    ("validation", "online"),
    ("comparison",),
    ("emulator",),
    ("cli",),
)
LEVEL = {room: level for level, floor in enumerate(FLOORS) for room in floor}


def room_of(module: str) -> str:
    """The room that a module name, without the package, lies in."""
    parts = module.split(".")
    return next(room for n in (2, 1) if (room := ".".join(parts[:n])) in LEVEL)


def imports(file: Path) -> set[str]:
    """Modules of this library that a file imports, without the package's name, those inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == ROOT.name:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name.partition(".")[2] for name in names}
        elif isinstance(node, ast.Import):
            found |= {a.name.partition(".")[2] for a in node.names if a.name.startswith(f"{ROOT.name}.")}
    return found


def test_arrows_run_down_only() -> None:
    wrong = []
    for file in sorted(ROOT.rglob("*.py")):
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if module == "__init__":
            continue  # the front door shows every floor
        here = room_of(module)
        for other in map(room_of, imports(file)):
            if other != here and LEVEL[other] >= LEVEL[here]:
                wrong.append(f"{module} imports {other}")
    assert not wrong, "\n".join(wrong)
