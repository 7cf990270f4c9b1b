"""Compile a model to machine code, through SymPy, and cache the result on disk.

The cache is in $JOINT_ID_CACHE_DIR, else in joint_id under $XDG_CACHE_HOME or ~/.cache. Its key contains the source of
the model and of the generator and the numba version. So it never has to be cleared; if it is deleted, models are
compiled again.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
import time
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType

from joint_id_core import models
from joint_id_core.cell import CELLS
from joint_id_core.cell.loops import (
    arrays,
    control,
    hop,
    hysteresis,
    information,
    innovations,
    newton,
    noise,
    simulate,
    streams,
    stretches,
    tracking,
)
from joint_id_core.cell.module_cache import Functions, cache_directory, loaded
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model

_SIMULATION: Functions = (simulate.rollout, simulate.jacobians, simulate.spectral_radius)
_FILTER: Functions = (innovations.innovations, innovations.observations)
_TRACKING: Functions = (tracking.track,)
_SENSITIVITIES: Functions = (simulate.rollout_sensitivities,)
_CONTROL: Functions = (control.follow,)
_GAINS: Functions = (
    noise.noise_information, noise.bounded_step, noise.disturbances, newton.with_prior, newton.damped_step,
)  # fmt: skip
_SHARED: Functions = (
    information.inverse, information.newest, information.change, information.of_free, stretches.scan,
    streams.steps, streams.always_moves, streams.moving, hop.lead, hop.curve, hop.physical, hop.apart,
    hysteresis.turned,
)  # fmt: skip


@dataclass(frozen=True)
class Kernel:
    """The compiled cell of a model.

    `parameter_names` gives the order of p, `sensitive` the order of the sensitivity columns. `module` holds the
    functions that a fit needs.
    """

    model: Model
    friction: str
    cell: str
    parameter_names: tuple[str, ...]
    sensitive: tuple[str, ...]
    module: ModuleType

    @cached_property
    def sensitivities(self) -> ModuleType:
        """Module with `rollout_sensitivities`. Only some users of a cell need it, so it is compiled at first use."""
        return _cell(self.model, self.friction, self.sensitive, self.cell, "sensitivities", _SENSITIVITIES)

    @cached_property
    def tracking(self) -> ModuleType:
        """Module with `track`. Only online identification needs it, so it is compiled at first use."""
        return _cell(self.model, self.friction, self.sensitive, self.cell, "tracking", _TRACKING)

    @cached_property
    def control(self) -> ModuleType:
        """Module with `follow`. Only the design of motions needs it, so it is compiled at first use."""
        return _cell(self.model, self.friction, self.sensitive, self.cell, "control", _CONTROL)

    @cached_property
    def gains(self) -> ModuleType:
        """Module of `loops.noise` and `loops.newton`, shared by all models with as many states and inputs."""
        return _gains(len(self.model.states), len(self.model.inputs), bool(self.model.label_delays))


@lru_cache(maxsize=1)
def _generator_text() -> str:
    """Return the source of all files whose change needs a rebuild; it is part of the cache key."""
    here = Path(__file__).parent
    files = [*sorted((here.parent / "models").glob("*.py")), *sorted(here.rglob("*.py"))]
    return "".join(f.read_text() for f in files)


def _key(model: Model, friction: str, sensitive: tuple[str, ...], cell: str) -> str:
    if type(model).__module__.startswith(models.__name__ + "."):
        own = ""
    else:
        try:
            own = inspect.getsource(sys.modules[type(model).__module__])
        except (OSError, TypeError):  # a model defined at a prompt has no source
            own = repr(id(type(model))) + str(time.time())
    return _hash(repr(model), friction, repr(sensitive), cell, own)


def _hash(*parts: str) -> str:
    import numba

    return hashlib.sha256("\0".join((*parts, numba.__version__, sys.version, _generator_text())).encode()).hexdigest()[
        :16
    ]


@lru_cache(maxsize=8)
def _cell_source(model: Model, friction: str, sensitive: tuple[str, ...], cell: str) -> str:
    """Return the source of the sizes and functions of a model, which the loops use."""
    from joint_id_core.cell.rk4_source import cell_text
    from joint_id_core.cell.symbolic import derive

    derivative = derive(model, friction, sensitive)  # type: ignore[arg-type]  # checked by compile_model
    return cell_text(model, derivative, cell)  # type: ignore[arg-type]  # checked by compile_model


_MODULE = '''"""Generated for {what}: do not edit."""

import math

{imports}
from joint_id_core.cell.translate import compiled, translated

{cell}'''
_FUNCTION = """

translated_{name} = translated({module}.{name}, globals())


@compiled("{signature}")
def {name}({arguments}):
    return translated_{name}({arguments})
"""


def _module_source(what: str, cell: str, functions: Functions) -> str:
    """Return the source of a module that compiles `functions`, which call those of `cell`."""
    imports = "\n".join(sorted({f"import {function.__module__}" for function in functions}))
    text = _MODULE.format(what=what, imports=imports, cell=cell)
    for function in functions:
        arguments = inspect.get_annotations(function)
        result = arrays.NUMBA[arguments.pop("return")]
        text += _FUNCTION.format(
            name=function.__name__,
            module=function.__module__,
            arguments=", ".join(arguments),
            signature=f"{result}({', '.join(arrays.NUMBA[kind] for kind in arguments.values())})",
        )
    return text


@lru_cache(maxsize=64)
def compile_model(model: Model, friction: str = "tanh", extra: tuple[str, ...] = (), cell: str = "rk4") -> Kernel:
    """Compile the cell of a model with its sensitivities, or load it from the cache.

    The kernel has sensitivities for every parameter that is not fixed in the model's table, and for `extra`.
    `friction` is "tanh" (smoothed) or "sign" (the paper's network; simulation only, without the innovations form).
    `cell` is "rk4" or, for stiff models with smoothed friction, "implicit" (see `loops.esdirk`).

    Raises:
        JointIdError: unknown friction smoothing, cell or parameter name in `extra`; sign friction in the implicit cell;
            the cache cannot be written.
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
    functions = _SIMULATION + _FILTER if friction == "tanh" else _SIMULATION  # the H-PINN needs only simulation
    module = _cell(model, friction, sensitive, cell, "kernel", functions)
    kernel = Kernel(model, friction, cell, model.parameter_names, sensitive, module)
    if friction == "tanh":
        _ = kernel.gains  # compile it now, not during the first fit
    return kernel


def is_compiled(model: Model, friction: str = "tanh", extra: tuple[str, ...] = (), cell: str = "rk4") -> bool:
    """Return whether the cache has the kernel that `compile_model` would return for the same arguments."""
    sensitive = tuple(p.name for p in model.parameters if not p.fixed or p.name in extra)
    return _path(model, friction, sensitive, cell, "kernel").exists()


def preparing(model: Model, friction: str = "tanh", extra: tuple[str, ...] = (), cell: str = "rk4") -> str:
    """Return in words what `compile_model` is going to do, and how long that takes."""
    if is_compiled(model, friction, extra, cell):
        return f"loading the compiled cell of {model.name}"
    return f"compiling {model.name}, which takes 10 to 20 s, once"


def _path(model: Model, friction: str, sensitive: tuple[str, ...], cell: str, part: str) -> Path:
    """Return the file of one module of the kernel of a model."""
    return cache_directory() / f"{model.name}-{_key(model, friction, sensitive, cell)}" / f"{part}.py"


def _cell(
    model: Model, friction: str, sensitive: tuple[str, ...], cell: str, part: str, functions: Functions
) -> ModuleType:
    """Return one module of the kernel of a model."""

    def source() -> str:
        text = _cell_source(model, friction, sensitive, cell)
        return _module_source(f"{model!r}, friction {friction}, cell {cell}", text, functions)

    path = _path(model, friction, sensitive, cell, part)
    return loaded(path, f"model {model.name}", source, functions)


@lru_cache(maxsize=64)
def _gains(states: int, inputs: int, delayed: bool) -> ModuleType:
    """Return the compiled `loops.noise` and `loops.newton` for these numbers of states and inputs."""
    columns = simulate.padded(states + inputs)
    sizes = f"NX = {states}\nNU = {inputs}\nCL = {columns}\nCD = {noise.DISTURBANCES}\nDELAYED = {delayed}\n"
    what = f"noise statistics of {states} states and {inputs} inputs"
    path = cache_directory() / f"gains-{_hash(sizes)}" / "gains.py"
    return loaded(path, what, lambda: _module_source(what, sizes, _GAINS), _GAINS)


@lru_cache(maxsize=1)
def compile_shared() -> ModuleType:
    """Return what all models share: compiled `loops.information`, `stretches`, `streams`, `hop` and `hysteresis`."""
    path = cache_directory() / f"shared-{_hash()}" / "shared.py"
    what = "functions that all models share"
    return loaded(path, what, lambda: _module_source(what, "", _SHARED), _SHARED)
