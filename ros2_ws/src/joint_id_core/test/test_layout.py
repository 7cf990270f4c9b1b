"""The rooms of the library stand in floors: a room imports only from rooms below it, and none imports ROS."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import joint_id_core

ROOT = Path(joint_id_core.__file__).parent
# From the ground up; what stands on one line does not import from each other.
FLOORS = (
    ("errors",),
    ("arguments", "assignments", "options", "text_file"),
    ("data",),
    ("models", "filtering", "rtde"),
    ("formats",),
    ("checking",),
    ("cell", "simulation", "results", "alignment"),
    ("tensors", "estimators.shared"),
    ("estimators.innovations", "estimators.hpinn"),
    ("estimators",),
    ("validation", "online", "arm"),
    ("comparison", "stored", "pages", "design"),
    ("emulator", "doctor", "jobs"),
    ("batch",),
    ("cli",),
    ("command",),
)
LEVEL = {room: level for level, floor in enumerate(FLOORS) for room in floor}


# All that the library may import beside itself and what is part of Python: no package of ROS is among them.
LIBRARIES = {
    "distributed", "fsspec", "llvmlite", "matplotlib", "mcap", "mujoco", "numba", "numpy", "pandas", "pinocchio",
    "pyarrow", "rosbags", "rtde_receive", "scipy", "sympy", "torch", "typer", "yaml",
}  # fmt: skip


def room_of(module: str) -> str:
    """The room that a module name, without the package, lies in."""
    parts = module.split(".")
    return next(room for n in (2, 1) if (room := ".".join(parts[:n])) in LEVEL)


def modules_of(file: Path) -> set[str]:
    """Every module that a file imports, and every name that it imports from one, those inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, f"{file}, line {node.lineno}: write the whole name of the module"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def imports(file: Path) -> set[str]:
    """Modules of this library that a file imports, without the package's name."""
    inside = f"{ROOT.name}."
    return {name.removeprefix(inside) for name in modules_of(file) if name.startswith(inside)}


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


def test_the_library_imports_no_ros() -> None:
    may = LIBRARIES | sys.stdlib_module_names | {ROOT.name}
    wrong = [
        f"{file.relative_to(ROOT)} imports {module}"
        for file in sorted(ROOT.rglob("*.py"))
        for module in sorted(modules_of(file))
        if module.split(".")[0] not in may
    ]
    assert not wrong, "\n".join(wrong)
