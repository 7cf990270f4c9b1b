"""Every example runs as it stands, and says what it should."""

from __future__ import annotations

import ast
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
FILES = sorted(EXAMPLES.glob("*.py"))
# A line of the output that only a right result gives.
SAYS = {
    "01": r"stiffness (79\d\d|80\d\d) ± \d+ Nm/rad \(estimated\); the truth is 8000",
    "02": r"<Estimate harmonic_drive by innovations: converged, .*k_1 51\d\d ± ",
    "03": r"c_2: 1\.5\d* ± ",
    "04": r"m_gl: (9|9\.0\d*|8\.99\d*) ± ",
    "05": r"best: rigid_joint:stribeck\n",
    "06": r"k_t known to 5 %: J = \S+ ± 0\.0(4|5|6)",
    "07": r"6\.00 s  k_1 = (59|60)\d\d\.\d ± .* converged",
    "08": r"innovations: converged",
    "09": r"(?s)link_position: predicted 0\.1 s ahead to 0\.00",
    "10": r"see fit\.png",
}


def test_they_are_numbered_short_and_listed() -> None:
    assert [file.name[:2] for file in FILES] == [f"{k:02d}" for k in range(1, 11)] == list(SAYS)
    page = (EXAMPLES / "README.md").read_text()
    for file in FILES:
        assert len(file.read_text().splitlines()) <= 60, file.name
        assert f"({file.name})" in page


def test_it_runs_as_a_program_and_again_where_it_has_run_before(tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text("time_s,torque\n0,1\n")
    done = subprocess.run(
        [sys.executable, FILES[0]], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(SAYS["01"], done.stdout), done.stdout


@pytest.mark.parametrize("file", FILES[1:], ids=lambda file: file.stem)
def test_it_runs(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process, which spares the imports."""
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(file), run_name="__main__")
    out = capsys.readouterr().out
    assert re.search(SAYS[file.name[:2]], out), out


def test_python_of_the_set_up_knows_the_library_without_more(tmp_path: Path) -> None:
    """As README has it: with .venv/bin in PATH, from any folder, and nothing else of the environment."""
    if not Path(sys.prefix, "joint_id.env").exists():
        pytest.skip("not the environment of make setup")
    clean = {name: os.environ[name] for name in ("HOME",) if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", "import joint_id_core; print(joint_id_core.build('rigid_joint').name)"],
        capture_output=True, text=True, cwd=tmp_path, env=clean, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and done.stdout.strip() == "rigid_joint", done.stderr


def test_every_cell_of_the_notebook_runs_and_shows_what_it_says(tmp_path: Path) -> None:
    """The cells are run as Jupyter does, in one namespace; what a last line gives is shown."""
    cells = json.loads((EXAMPLES / "notebook.ipynb").read_text())["cells"]
    code = ["".join(c["source"]) for c in cells if c["cell_type"] == "code"]
    assert all(not c["outputs"] for c in cells if c["cell_type"] == "code")  # nothing that grows old is stored
    names: dict[str, object] = {}
    shown = []
    for text in code:
        tree = ast.parse("\n".join(line for line in text.splitlines() if not line.startswith("%")))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "notebook", "exec"), names)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), "notebook", "eval"), names))
    page, picture, frame, other = [value for value in shown if value is not None]
    assert "<table>" in page._repr_html_() and picture.axes and other.loc["J", "verdict"] == "estimated"
    assert abs(frame.loc["J", "value"] - 2.0) < 4.0 * frame.loc["J", "std_dev"]
