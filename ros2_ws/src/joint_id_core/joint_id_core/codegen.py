"""Model -> SymPy -> one compiled module, cached on disk.

The cache lives in $JOINT_ID_CACHE_DIR, else in joint_id under $XDG_CACHE_HOME or ~/.cache. It is keyed by the
text of the model, of the generator and by the numba version, so it never has to be cleared; deleting it
only costs a compilation.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import inspect
import logging
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import TextIO

from joint_id_core import filter_recursions, gain_recursions, implicit, models, recursions
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model

log = logging.getLogger(__name__)

# No "nnan": it would let the compiler drop the NaN test that marks a missing label.
_FASTMATH = "{'reassoc', 'contract', 'arcp', 'nsz'}"
_V, _M, _T, _I = "float64[::1]", "float64[:, ::1]", "float64[:, :, ::1]", "int64[::1]"
_SENSITIVITIES = {"rollout_sensitivities": f"void({_V}, {_V}, {_M}, {_V}, {_I}, {_M}, {_T})"}
_SIMULATION = {
    "rollout": f"void({_M}, int64, {_V}, {_M}, {_V}, {_I}, {_M})",
    "jacobians": f"void({_M}, {_M}, {_V}, {_T})",
}
_FILTER = {
    "innovations": f"float64({_V}, {_M}, {_I}, {_M}, {_M}, {_V}, {_M}, {_M}, {_I}, {_V}, {_V}, {_V}, "
    f"{_V}, {_V}, {_I}, {_M}, {_M}, {_M}, {_T}, {_T}, {_T}, {_T}, {_M}, {_V})",
    "noise_information": f"void({_M}, {_I}, {_I}, {_M}, {_M}, {_T}, {_T}, {_T}, {_V}, {_M})",
    "bounded_step": f"float64({_V}, {_M}, {_V}, {_V}, {_V}, float64, float64, {_V})",
    "responses": f"void({_M}, {_I}, {_I}, {_M}, {_T}, {_T}, {_T}, {_I}, {_M}, {_T})",
    "observations": f"void({_M}, {_M}, {_V}, {_M})",
}
# Called by those, never from Python: typed where they are called.
_INLINE = (
    "constants", "jacobian", "observe", "inputs", "slope", "linearise", "factor", "solve", "matrix", "solve_stage",
    "stages", "step", "step_parameters", "step_full", "work_space",
)  # fmt: skip
CELLS = ("rk4", "implicit")


@dataclass(frozen=True)
class Kernel:
    """The compiled cell of a model.

    `parameter_names` is the order of p, `sensitive` that of sensitivity columns, `module` has the functions of a fit.
    """

    model: Model
    friction: str
    cell: str
    parameter_names: tuple[str, ...]
    sensitive: tuple[str, ...]
    module: ModuleType

    @cached_property
    def sensitivities(self) -> ModuleType:
        """Has `rollout_sensitivities`, which only some users of a cell need: compiled when it is first asked for."""
        return _loaded(self.model, self.friction, self.sensitive, self.cell, "sensitivities")


def cache_directory() -> Path:
    """Folder of the compiled kernels."""
    explicit = os.environ.get("JOINT_ID_CACHE_DIR")
    if explicit:
        return Path(explicit)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "joint_id"


@lru_cache(maxsize=1)
def _generator_text() -> str:
    """Text of everything that shapes generated code; a change in it gives a new cache key."""
    here = Path(__file__).parent
    own = ("symbolic", "cell_text", "recursions", "filter_recursions", "gain_recursions", "implicit", "codegen")
    files = [*sorted((here / "models").glob("*.py")), *(here / f"{name}.py" for name in own)]
    return "".join(f.read_text() for f in files)


def _key(model: Model, friction: str, sensitive: tuple[str, ...], cell: str) -> str:
    import numba

    if type(model).__module__.startswith(models.__name__ + "."):
        own = ""
    else:
        try:
            own = inspect.getsource(sys.modules[type(model).__module__])
        except (OSError, TypeError):  # a model typed at a prompt has no source
            own = repr(id(type(model))) + str(time.time())
    parts = (repr(model), friction, repr(sensitive), cell, numba.__version__, sys.version, own, _generator_text())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _source(model: Model, friction: str, sensitive: tuple[str, ...], cell: str, part: str) -> str:
    from joint_id_core.cell_text import cell_text
    from joint_id_core.symbolic import derive

    derivative = derive(model, friction, sensitive)  # type: ignore[arg-type]  # checked by compile_model
    text = cell_text(model, derivative, cell)  # type: ignore[arg-type]  # checked by compile_model
    if cell == "implicit":
        text += _implicit_steps()
    for loops in (recursions, filter_recursions, gain_recursions) if friction == "tanh" else (recursions,):
        text += _after_mark(loops)
    text = re.sub(r": (Any|int|float|bool)\b|-> (None|float|Any)", "", text).replace(") :", "):")
    wanted = _signatures(friction, part)
    for name in {**_SENSITIVITIES, **_SIMULATION, **_FILTER}.keys() - wanted.keys():
        text = re.sub(rf"\ndef {name}\(.*?(?=\n\n\n|\Z)", "", text, flags=re.DOTALL)
    for name, signature in wanted.items():
        decorator = f'@njit("{signature}", cache=True, fastmath={_FASTMATH}, nogil=True, error_model="numpy")\n'
        text = text.replace(f"def {name}(", f"{decorator}def {name}(")
    inline = f'@njit(fastmath={_FASTMATH}, error_model="numpy")\n'
    for name in _INLINE:
        text = text.replace(f"def {name}(", f"{inline}def {name}(")
    head = f'"""Generated for {model!r}, friction {friction}, cell {cell}: do not edit."""\n\n'
    head += "import math\n\nimport numpy as np\nfrom numba import njit\n\n"
    return head + text


def _after_mark(loops: ModuleType) -> str:
    """The text of a module from where it is compiled."""
    _, text = re.split(r"# --- compiled .*\n", inspect.getsource(loops))
    return text


def _implicit_steps() -> str:
    """The implicit cell, its last function once for the parameters alone and once with states and inputs."""
    text = _after_mark(implicit)
    shared, template = text.split("def step_COLUMNS")
    for name, columns in (("step_parameters", "CP"), ("step_full", "CF")):
        shared += f"def {name}{template}".replace("COLUMNS", columns)
    return shared


def _signatures(friction: str, part: str) -> dict[str, str]:
    """Types of the compiled functions of a part; with sign friction only those of the simulation, which H-PINN uses."""
    if part == "sensitivities":
        return _SENSITIVITIES
    return {**_SIMULATION, **_FILTER} if friction == "tanh" else _SIMULATION


def _build(folder: Path, model: Model, friction: str, sensitive: tuple[str, ...], cell: str, part: str) -> ModuleType:
    """Load a part of the kernel in `folder`, after writing its source if it is not there."""
    path = folder / f"{part}.py"
    if not path.exists():
        log.info("compiling model %s once, about 15 s; the result is kept in %s", model.name, folder)
        draft = path.with_suffix(".draft")
        draft.write_text(_source(model, friction, sensitive, cell, part))
        draft.replace(path)
    spec = importlib.util.spec_from_file_location(f"joint_id_{part}_{path.parent.name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    with _short_loops_vectorised():
        spec.loader.exec_module(module)
    missing = [name for name in _signatures(friction, part) if not hasattr(module, name)]
    if missing:  # a file cut short by a full disk is still valid Python
        raise ImportError(f"{path} has no {', '.join(missing)}")
    return module


@contextmanager
def _short_loops_vectorised() -> Iterator[None]:
    """Let the compiler turn unrolled code into vector instructions: it unrolls loops over a few columns first.

    Numba leaves that out; with it a pass of the innovations form takes 0.9 and its noise information 0.45 of the time.
    """
    from numba import config

    before = config.SLP_VECTORIZE
    config.SLP_VECTORIZE = 1
    try:
        yield
    finally:
        config.SLP_VECTORIZE = before


def _locked(folder: Path) -> TextIO:
    """Make the folder and lock it: a second process waits for the first one's build instead of repeating it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = folder.with_suffix(".lock").open("w")
    except OSError as error:
        raise JointIdError(
            f"cannot keep compiled kernels in {folder.parent} ({error.strerror}): "
            "set JOINT_ID_CACHE_DIR to a folder that can be written"
        ) from error
    fcntl.flock(lock, fcntl.LOCK_EX)
    return lock


@lru_cache(maxsize=64)
def compile_model(model: Model, friction: str = "tanh", extra: tuple[str, ...] = (), cell: str = "rk4") -> Kernel:
    """Compile the cell of a model with its sensitivities, or load it from the cache.

    Sensitivities are made for every parameter that the model's table does not fix, and for `extra`.
    `friction` is "tanh" (smoothed) or "sign" (the paper's network; simulation only, without the innovations form).
    `cell` is "rk4" or, for stiff models with smoothed friction, "implicit" (see `implicit`).

    Raises:
        JointIdError: unknown friction smoothing, cell or parameter name in `extra`; sign friction in the implicit cell;
            a cache that cannot be written.
    """
    if friction not in ("tanh", "sign"):
        raise JointIdError(f"unknown friction smoothing {friction!r}: choose tanh or sign")
    if cell not in CELLS:
        raise JointIdError(f"unknown cell {cell!r}: choose one of {', '.join(CELLS)}")
    if (friction, cell) == ("sign", "implicit"):
        raise JointIdError("the implicit cell needs smoothed friction: sign has no derivative to solve with")
    for name in extra:
        model.parameter(name)
    sensitive = tuple(p.name for p in model.parameters if not p.fixed or p.name in extra)
    module = _loaded(model, friction, sensitive, cell, "kernel")
    return Kernel(model, friction, cell, model.parameter_names, sensitive, module)


def _loaded(model: Model, friction: str, sensitive: tuple[str, ...], cell: str, part: str) -> ModuleType:
    """A part of the kernel, from the cache or compiled."""
    folder = cache_directory() / f"{model.name}-{_key(model, friction, sensitive, cell)}"
    with _locked(folder):
        try:
            return _build(folder, model, friction, sensitive, cell, part)
        except Exception as error:  # whatever is wrong with a cached file, a fresh build is the cure
            log.warning("the cached kernel in %s cannot be loaded (%s): building it again", folder, error)
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            return _build(folder, model, friction, sensitive, cell, part)
