"""Compiled kernels: models of one's own, and a cache that survives whatever happens to it."""

from __future__ import annotations

import errno
import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from joint_id_core.cell import module_cache
from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.module_cache import cache_directory
from joint_id_core.cell.rollout import rollout
from joint_id_core.data.signals import Parameter, channel, positive
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model, build
from joint_id_core.simulation.simulator import simulate


@dataclass(frozen=True)
class Propeller(Model):
    """A shaft braked by a dry seal and the square of its speed: physics that the library has never seen."""

    name = "propeller"
    summary = "shaft with quadratic drag"

    @property
    def states(self):
        return (channel("link_velocity"),)

    @property
    def inputs(self):
        return (channel("torque"),)

    @property
    def parameters(self):
        return (
            positive("J", "kg m^2", "inertia", 2.0),
            positive("d", "Nm s^2/rad^2", "drag", 0.5),
            positive("tau_f", "Nm", "friction of the seal", 3.0),
            Parameter("w_s", "rad/s", "smoothing", 1e-3, lower=1e-9, fixed=True),
        )

    def derivative(self, x, u, p, ops):
        (w,), (tau,) = x, u
        return ((tau - (p.tau_f + p.d * w * w) * ops.direction("link_velocity", w, p.w_s)) / p.J,)


TIME = np.linspace(0.0, 2.0, 101)
NO_TORQUE = np.zeros((101, 1))
# J dw/dt = -(tau_f + d w^2) from 6 rad/s, until it stops for good; and with the seal left out
SEALED = np.sqrt(6.0) * np.tan(np.maximum(np.arctan(np.sqrt(6.0)) - np.sqrt(1.5) * TIME / 2.0, 0.0))
FREE = 6.0 / (1.0 + 0.5 * 6.0 * TIME / 2.0)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache of this test alone."""
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "kernels"))
    compile_model.cache_clear()
    yield tmp_path / "kernels"
    compile_model.cache_clear()


def coast(kernel, tau_f=0.0):
    return rollout(kernel, np.array([6.0]), TIME, NO_TORQUE, np.array([2.0, 0.5, tau_f, 1e-3]), 4)[:, 0]


def test_a_model_of_ones_own_runs_compiled_and_in_the_simulator():
    """One `derivative` serves both, and both follow the closed form, also where friction vanishes at rest."""
    kernel = compile_model(Propeller())
    for tau_f, closed_form in ((3.0, SEALED), (0.0, FREE)):
        moving = closed_form > 0.1
        np.testing.assert_allclose(coast(kernel, tau_f)[moving], closed_form[moving], rtol=1e-6)
        simulated = simulate(
            Propeller(), TIME, {"torque": NO_TORQUE[:, 0]}, {"tau_f": tau_f}, x0={"link_velocity": 6.0}
        )
        np.testing.assert_allclose(simulated["link_velocity"], closed_form, rtol=1e-5, atol=1e-6)


def test_cache_is_used_and_built_again_when_it_is_broken(cache):
    compile_model(Propeller(), "sign")
    (kernel,) = cache.glob("*/kernel.py")
    text = kernel.read_text()
    files = {f: f.stat().st_mtime_ns for f in cache.rglob("*") if f.suffix in (".py", ".nbc")}
    assert len(files) > 1, "machine code must be kept, not only its source"
    compile_model.cache_clear()
    compile_model(Propeller(), "sign")
    assert files == {f: f.stat().st_mtime_ns for f in files}, "a second load must compile nothing"

    def damage_index():
        for index in kernel.parent.glob("__pycache__/*.nbi"):
            index.write_bytes(b"not an index")

    damages = {"empty": lambda: kernel.write_text(""), "index": damage_index}
    for what, damage in damages.items():
        damage()
        compile_model.cache_clear()
        np.testing.assert_allclose(coast(compile_model(Propeller(), "sign")), FREE, rtol=1e-7, err_msg=what)
        assert kernel.read_text() == text, what


def test_an_edited_model_gets_a_new_kernel(cache, tmp_path):
    """The physics of a user's file may change between two runs; the old kernel must never answer for it."""
    path = tmp_path / "own_model.py"
    text = """
from dataclasses import dataclass
from joint_id_core.models import Model
from joint_id_core.data.signals import channel, positive

@dataclass(frozen=True)
class Own(Model):
    name = "own"
    summary = "first-order lag"
    states = property(lambda self: (channel("link_velocity"),))
    inputs = property(lambda self: (channel("torque"),))
    parameters = property(lambda self: (positive("J", "kg m^2", "inertia", 1.0),))

    def derivative(self, x, u, p, ops):
        return (-FACTOR * x[0] / p.J,)
"""
    for factor in (1.0, 25.0):
        path.write_text(text.replace("FACTOR", str(factor)))
        spec = importlib.util.spec_from_file_location("own_model", path)
        sys.modules["own_model"] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        X = rollout(
            compile_model(module.Own(), "sign"), np.array([1.0]), TIME[:11], NO_TORQUE[:11], np.array([1.0]), 20
        )
        np.testing.assert_allclose(X[:, 0], np.exp(-factor * TIME[:11]), rtol=1e-6)
    del sys.modules["own_model"]


@pytest.mark.long
def test_two_processes_that_compile_at_once(tmp_path):
    """Nodes of two joints start together with an empty cache: both work, and the cache is whole afterwards."""
    code = (
        "import numpy as np\n"
        "from joint_id_core.cell.kernel import compile_model\n"
        "from joint_id_core.models import build\n"
        "from joint_id_core.cell.rollout import rollout\n"
        "m = build('dc_motor')\n"
        "p = np.array(list(m.values().values()))\n"
        "X = rollout(compile_model(m, 'sign'), np.zeros(2), np.arange(50) * 1e-4, np.full((50, 2), [12.0, 0.0]), p)\n"
        "print(repr(float(X[-1, 1])))"
    )
    environment = {**os.environ, "JOINT_ID_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    start = [sys.executable, "-W", "error::UserWarning", "-c", code]
    both = [
        subprocess.Popen(start, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    answers = [process.communicate(timeout=300) for process in both]
    third = subprocess.run(start, env=environment, capture_output=True, text=True, timeout=300, check=False)
    for process, (_, error) in zip(both, answers, strict=True):
        assert (process.returncode, error) == (0, "")
    assert (third.returncode, third.stderr) == (0, "")
    assert answers[0][0] == answers[1][0] == third.stdout
    assert float(third.stdout) > 0.0
    assert len(list(tmp_path.glob("*/kernel.py"))) == 1


def test_folder_of_the_cache(monkeypatch, tmp_path):
    monkeypatch.delenv("JOINT_ID_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_directory() == tmp_path / "joint_id"
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "own"))
    assert cache_directory() == tmp_path / "own"


def test_a_cache_that_cannot_be_written_is_named(cache):
    cache.write_text("a file where a folder should be")
    with pytest.raises(JointIdError, match=r"kernels.*JOINT_ID_CACHE_DIR"):
        compile_model(Propeller())


def test_a_cache_that_cannot_be_written_still_serves_what_it_has(cache, monkeypatch):
    """As one that an administrator filled for all users."""
    compile_model(Propeller(), "sign")
    kept = {file: file.stat().st_mtime_ns for file in cache.rglob("*")}

    def closed(folder):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(module_cache, "_locked", closed)
    compile_model.cache_clear()
    np.testing.assert_allclose(coast(compile_model(Propeller(), "sign")), FREE, rtol=1e-7)
    assert {file: file.stat().st_mtime_ns for file in cache.rglob("*")} == kept
    with pytest.raises(JointIdError, match=r"Read-only file system.*JOINT_ID_CACHE_DIR"):
        compile_model(build("dc_motor"), extra=("R",))


def test_misuse_is_named():
    with pytest.raises(JointIdError, match="unknown friction smoothing 'relay': choose tanh or sign"):
        compile_model(build("dc_motor"), "relay")
    with pytest.raises(JointIdError, match="model dc_motor has no parameter 'k_9'"):
        compile_model(build("dc_motor"), "tanh", ("k_9",))
