"""`make test-haswell` does what it says: NumPy and kernels without AVX-512, beside the kernels of this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(os.environ.get("NUMBA_CPU_NAME") != "haswell", reason="run by make test-haswell")

COMPILED = """
import json, re
from joint_id_core.cell.kernel import compile_model
from joint_id_core.models import build

step = compile_model(build("rigid_joint")).module.innovations
hits = sum(step.stats.cache_hits.values())
text = "" if hits else "".join(step.inspect_asm().values())  # a cached kernel does not show its code
print(json.dumps({"hits": hits, "wide": len(re.findall("%zmm", text)), "vectors": len(re.findall("%ymm", text))}))
"""


def test_numpy_has_no_avx512():
    from numpy._core import _multiarray_umath as build

    off = [name for name in build.__cpu_dispatch__ if "512" in name or name == "X86_V4"]
    assert not any(build.__cpu_features__[name] for name in off), np.__version__


def test_kernels_of_two_processors_live_side_by_side(tmp_path):
    """Neither is loaded in place of the other, and those of the lesser one have no instruction of 512 bits."""

    def compiled(lesser):
        environment = os.environ | {"JOINT_ID_CACHE_DIR": str(tmp_path)}
        if not lesser:
            del environment["NUMBA_CPU_NAME"], environment["NUMBA_CPU_FEATURES"]
        run = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, env=environment)
        assert run.returncode == 0, run.stderr
        return json.loads(run.stdout)

    lesser, own = compiled(True), compiled(False)
    assert lesser["hits"] == 0 and lesser["wide"] == 0 and lesser["vectors"] > 0
    assert own["hits"] == 0, "the kernel of another processor was loaded"
    assert compiled(True)["hits"] == compiled(False)["hits"] == 1
