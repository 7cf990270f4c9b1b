"""`kernel.cpp`, compiled: what a rollout with all sensitivities costs in C++ written by hand for one model."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from engine.timing import Times
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model

SOURCE = Path(__file__).resolve().parent.parent / "kernel.cpp"
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")
# By model: the function, the parameters that it takes for these constants, and those without a sensitivity.
FUNCTIONS: dict[str, tuple[str, dict[str, float], frozenset[str]]] = {
    "harmonic_drive": ("model2", {"N": 101.0}, frozenset({"w_sm", "w_sq"})),
    "electromechanical": (
        "model3", {"N": 101.0, "tau_fq": 0.0, "w_sq": 3e-4}, frozenset({"L", "J_m", "w_sm", "J_q"})
    ),
}  # fmt: skip


class Rollout:
    """One call of the kernel, to be repeated.

    Attributes:
        names: parameters of the sensitivities.
        X, J: where each call writes states (T, n) and sensitivities (T, n, names).
    """

    def __init__(
        self, function: Any, names: tuple[str, ...], x0: Array, u: Array, p: Array, period_s: float, substeps: int
    ) -> None:
        self.names = names
        self.X, self.J = np.empty((len(u), len(x0))), np.empty((len(u), len(x0), len(names)))
        self._arrays = [np.array(a, dtype=float) for a in (x0, u, p)]  # kept: the kernel sees addresses
        x0_, u_, p_, X_, J_ = (
            a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (*self._arrays, self.X, self.J)
        )
        self._call = lambda: function(x0_, u_, p_, len(u), ctypes.c_double(period_s), substeps, X_, J_)

    def __call__(self) -> None:
        self._call()


class Yardstick:
    """The compiled kernels.

    Raises:
        JointIdError: no C++ compiler, or one that refuses the source.
    """

    def __init__(self) -> None:
        compiler = shutil.which("g++")
        if compiler is None:
            raise JointIdError("benchmarks/kernel.cpp needs g++: install it")
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "kernel.so"
            done = subprocess.run([compiler, *FLAGS, str(SOURCE), "-o", str(library)], capture_output=True, text=True)
            if done.returncode:
                raise JointIdError(f"{compiler} refuses {SOURCE}: {done.stderr.strip()}")
            self._library = ctypes.CDLL(str(library))

    def rollout(
        self, model: Model, x0: Array, u: Array, values: Mapping[str, float], period_s: float, substeps: int
    ) -> Rollout:
        """Simulate from x0 (n,) under the first input u (T,), the others being zero, with parameter `values`.

        Raises:
            JointIdError: a model that is not in `kernel.cpp`, or a value other than its constant.
        """
        if model.name not in FUNCTIONS or type(model)() != model:
            raise JointIdError(f"benchmarks/kernel.cpp has no {model!r}: it has {', '.join(FUNCTIONS)} without options")
        function, constants, held = FUNCTIONS[model.name]
        for name, constant in constants.items():
            if values[name] != constant:
                raise JointIdError(f"{name} = {values[name]}: benchmarks/kernel.cpp has {constant} for it")
        taken = tuple(name for name in model.parameter_names if name not in constants)
        p = np.array([values[name] for name in taken])
        names = tuple(name for name in taken if name not in held)
        return Rollout(getattr(self._library, function), names, x0, u, p, period_s, substeps)


def rollouts(make: Callable[[int], Rollout], steps: float) -> dict[str, Rollout]:
    """Two rollouts, with the whole numbers of steps a sample below and above `steps`: see `at_steps`."""
    below = int(steps)
    return {"kernel below": make(below), "kernel above": make(below + 1)}


def at_steps(times: Mapping[str, Times], steps: float) -> Times:
    """Time of the kernel at a mean number of `steps` a sample, from those of `rollouts`: it is linear in them."""
    return times["kernel below"].between(times["kernel above"], steps - int(steps))
