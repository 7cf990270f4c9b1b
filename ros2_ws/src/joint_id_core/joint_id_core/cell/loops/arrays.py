"""Argument types of compiled functions: contiguous arrays in C order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Cube = NDArray[np.float64]
Indices = NDArray[np.int64]

# The corresponding numba types, by the name of the annotation.
NUMBA = {
    "Vector": "float64[::1]",
    "Matrix": "float64[:, ::1]",
    "Cube": "float64[:, :, ::1]",
    "Indices": "int64[::1]",
    "float": "float64",
    "int": "int64",
    "None": "void",
}
