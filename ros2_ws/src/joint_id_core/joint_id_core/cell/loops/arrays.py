"""Types of what compiled functions take: arrays without gaps, row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Cube = NDArray[np.float64]
Indices = NDArray[np.int64]

# The same for numba, by the name that an annotation has.
NUMBA = {
    "Vector": "float64[::1]",
    "Matrix": "float64[:, ::1]",
    "Cube": "float64[:, :, ::1]",
    "Indices": "int64[::1]",
    "float": "float64",
    "int": "int64",
    "None": "void",
}
