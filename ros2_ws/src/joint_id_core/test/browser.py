"""A headless browser without a network: what a page holds after its script ran, and what it says in its console."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PROGRAM = next((path for name in NAMES if (path := shutil.which(name))), None)
MISSING = "no browser: install chromium"


@dataclass(frozen=True)
class Seen:
    """The page after its script ran, and the lines of its console."""

    page: str
    console: list[str]


def opened(path: Path, width: int = 1100) -> Seen:
    """Open a page of this width in px; every address but files leads nowhere."""
    assert PROGRAM is not None
    command = [
        PROGRAM, "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={path.parent}/browser", f"--window-size={width},900",
        "--virtual-time-budget=5000", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return Seen(done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line])
