"""The functions that a derivative may call (`models.Ops`), for floats, complex numbers and arrays."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np


class SmoothOps:
    """Coulomb friction smoothed by tanh(w / w_s), as in estimation."""

    sin = staticmethod(math.sin)
    cos = staticmethod(math.cos)
    exp = staticmethod(math.exp)
    asinh = staticmethod(math.asinh)

    @staticmethod
    def direction(velocity: str, w: float, w_s: float) -> float:
        """Return the smoothed direction of sliding."""
        return math.tanh(w / w_s)


class SignOps(SmoothOps):
    """Coulomb friction with the plain sign function, as in the paper."""

    @staticmethod
    def direction(velocity: str, w: float, w_s: float) -> float:
        """Return the sign of the velocity."""
        return (w > 0) - (w < 0)


class ComplexOps:
    """Smoothed Coulomb friction on complex numbers."""

    sin = staticmethod(cmath.sin)
    cos = staticmethod(cmath.cos)
    exp = staticmethod(cmath.exp)
    asinh = staticmethod(cmath.asinh)

    @staticmethod
    def direction(velocity: str, w: complex, w_s: complex) -> complex:
        """Return the smoothed direction of sliding."""
        x = w / w_s
        return cmath.tanh(x) if abs(x.real) < 300.0 else complex(math.copysign(1.0, x.real))  # tanh overflows there


class ArrayOps:
    """Smoothed Coulomb friction on NumPy arrays."""

    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    exp = staticmethod(np.exp)
    asinh = staticmethod(np.arcsinh)

    @staticmethod
    def direction(velocity: str, w: Any, w_s: Any) -> Any:
        """Return the smoothed direction of sliding."""
        return np.tanh(w / w_s)
