"""Code blocks of the pages: what they contain, and why some are not run."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUTSIDE_DOCS = (
    "README.md",
    "CONTRIBUTING.md",
    "QUALITY_DECLARATION.md",
    "CHANGELOG.md",
    "bags/README.md",
    "examples/README.md",
)
PAGES = [*(ROOT / name for name in OUTSIDE_DOCS), *sorted((ROOT / "docs").rglob("*.md"))]
RST = sorted((ROOT / "ros2_ws/src").glob("*/doc/*.rst"))  # first pages of what rosdoc2 makes

# A fence, which may be indented inside a list, with the comment on the line before it, if there is one.
FENCE = re.compile(
    r"^(?:[ ]*<!--[ ](?P<comment>[^\n]*)[ ]-->\n)?(?P<indent>[ ]*)```(?P<language>\w*)\n(?P<body>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)
# The same in reStructuredText, where a comment is `.. not run: REASON`.
DIRECTIVE = re.compile(
    r"^(?:\.\.[ ](?P<comment>[^\n:]*not run:[^\n]*)\n\n)?\.\.[ ]code-block::[ ](?P<language>\w+)\n\n"
    r"(?P<body>(?:[ ]{3}[^\n]*\n|\n)+)",
    re.MULTILINE,
)
# `not run: REASON` excuses the block, `ros2 not run: REASON` its commands that begin with ros2.
EXCUSE = re.compile(r"(?:(?P<program>\S+) )?not run: (?P<reason>\S.*)")


def named(page: Path) -> str:
    """Name of a page relative to the repository, as the id of a test."""
    return str(page.relative_to(ROOT))


@dataclass(frozen=True)
class Block:
    """One fenced block; with a `reason` not to run the commands of `program`, or all of them if that is empty."""

    language: str
    body: str
    program: str = ""
    reason: str = ""

    @property
    def commands(self) -> list[str]:
        """Lines of a shell block without comments, continuation lines joined."""
        lines = self.body.replace("\\\n", " ").splitlines()
        return [line.strip() for line in lines if shlex.split(line, comments=True)]

    def excuses(self, command: str) -> bool:
        """Whether this command is marked as not run."""
        return bool(self.reason) and self.program in ("", shlex.split(command)[0])


def blocks(page: Path) -> list[Block]:
    """All blocks of a page, in order."""
    found, rst = [], page.suffix == ".rst"
    for match in (DIRECTIVE if rst else FENCE).finditer(page.read_text()):
        excuse = EXCUSE.fullmatch(match["comment"] or "")
        indent = " " * 3 if rst else match["indent"]
        body = re.sub(f"^{indent}", "", match["body"], flags=re.MULTILINE)
        why = (excuse["program"] or "", excuse["reason"]) if excuse else ("", "")
        found.append(Block(match["language"], body, *why))
    return found


def bodies(page: Path, language: str) -> list[str]:
    """Text of the blocks in one language."""
    return [block.body for block in blocks(page) if block.language == language]


def command_lines(page: Path) -> list[list[str]]:
    """Words of every command of the shell blocks."""
    commands = [c for block in blocks(page) if block.language == "sh" for c in block.commands]
    return [shlex.split(command, comments=True) for command in commands]
