"""How many examples Hypothesis tries: few in `make test`, more in `make test-long`."""

from __future__ import annotations

import os

TIMES = int(os.environ.get("MORE_EXAMPLES", "1"))  # what the Makefile sets
