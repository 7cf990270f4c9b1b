"""The simulated arm of the tests of joint_id_core, which is another package."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def _loaded() -> ModuleType:
    file = Path(__file__).resolve().parents[1] / "ros2_ws/src/joint_id_core/test/moving_arm.py"
    specification = importlib.util.spec_from_file_location(file.stem, file)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[file.stem] = module  # dataclasses look for it there
    specification.loader.exec_module(module)
    return module


moving_arm = _loaded()
