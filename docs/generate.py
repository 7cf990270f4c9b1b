"""Rewrite the tables of README.md and docs/ from the code: `setup/run python docs/generate.py`.

A table stands between `<!-- generated: NAME -->` and `<!-- end -->`; NAME is a key of `tables()`. Nothing else is
touched. `tests/test_docs.py` fails when a table is not what the code says.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import typer

from joint_id_core.cli import app
from joint_id_core.data.signals import CHANNELS, Parameter
from joint_id_core.estimators import ESTIMATORS
from joint_id_core.formats.topics import RAW, SIGNALS
from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.options import FLAGS
from joint_id_core.results.estimate import Status
from joint_id_ros.fleet_command import fleet
from joint_id_ros.launch_files import LAUNCH_FILES, LaunchFile
from joint_id_ros.options.node_list import NODES
from joint_id_ros.record import record
from joint_id_ros.watch import watch

ROOT = Path(__file__).resolve().parent.parent
INTERFACES = ROOT / "ros2_ws/src/joint_id_msgs"
COMMANDS = (
    "fit",
    "report",
    "arm-fit",
    "arm-friction-scales",
    "design",
    "diff",
    "batch",
    "history",
    "many-starts",
    "bootstrap",
    "export",
    "compare",
    "simulate",
    "info",
    "record",
    "watch",
    "fleet",
    "robot-emulator",
    "doctor",
)
BLOCK = re.compile(r"(<!-- generated: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def pages() -> list[Path]:
    """README and every page of docs."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def rewrite(text: str) -> str:
    """The text with every generated block made anew; an unknown name is a KeyError."""
    made = tables()
    return BLOCK.sub(lambda m: f"{m[1]}{made[m[2]]}\n{m[3]}", text)


def tables() -> dict[str, str]:
    """All generated blocks by name."""
    made = {f"node-{name}": option_table(options) for name, options in NODES.items()}
    made |= {f"launch-{name}": launch_table(launch_file) for name, launch_file in LAUNCH_FILES.items()}
    made |= {f"estimator-{name}": option_table((options,)) for name, options in ESTIMATORS.items()}
    made |= {f"model-{name}": parameter_table(build(name).parameters) for name in MODELS}
    made |= {f"options-{name}": added_table(name) for name in MODELS}
    made |= {f"command-{name}": command_table(name) for name in COMMANDS}
    made |= {
        f"message-{p.stem}": f"```\n{p.read_text().rstrip()}\n```"
        for p in (*INTERFACES.glob("msg/*.msg"), *INTERFACES.glob("action/*.action"))
    }
    return made | {"models": model_table(), "channels": channel_table(), "statuses": status_table()}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def shown(value: Any) -> str:
    """A default as it is typed in a parameter file; `-` where there is none."""
    if value is MISSING:
        return "-"
    if isinstance(value, tuple):
        return f"`[{', '.join(map(str, value))}]`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if value is None or value == "" or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"`{value}`"


def option_table(options: Sequence[type]) -> str:
    """Name, default, range and meaning of every field of options dataclasses."""
    rows = []
    for f in (f for cls in options for f in fields(cls)):
        meta = f.metadata
        typed = [c or '""' for c in meta["choices"]]
        allowed = ", ".join(f"`{c}`" for c in typed)
        if not allowed and (meta["lower"] is not None or meta["upper"] is not None):
            low, high = (f"{v:g}" if v is not None else "" for v in (meta["lower"], meta["upper"]))
            allowed = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        rows.append([f"`{f.name}`", shown(f.default), meta["unit"] or "-", allowed or "-", meta["description"]])
    return table(["parameter", "default", "unit", "allowed", "meaning"], rows)


def launch_table(launch_file: LaunchFile) -> str:
    """Name, default, choices and meaning of every argument of a launch file."""
    rows = []
    for a in launch_file.arguments:
        default = "must be given" if a.default is None else f"`{a.default}`" if a.default else "-"
        choices = ", ".join(f"`{choice}`" if choice else '`""`' for choice in a.choices)
        rows.append([f"`{a.name}`", default, choices or "-", a.description])
    return table(["argument", "default", "allowed", "meaning"], rows)


def parameter_table(parameters: Iterable[Parameter]) -> str:
    """Every parameter with its start value, whether it is estimated, unit and meaning."""
    rows = []
    for p in parameters:
        start = "must be given" if math.isnan(p.nominal) else f"{p.nominal:g}"
        bounds = f"{p.lower:g} to {p.upper:g}"
        rows.append([f"`{p.name}`", p.unit, start, "held" if p.fixed else "estimated", bounds, p.meaning])
    return table(["parameter", "unit", "start value", "by default", "bounds", "meaning"], rows)


def added_table(name: str) -> str:
    """Parameters and states that each option adds to a model."""
    plain = {*build(name).parameter_names, *build(name).state_names}
    options: list[dict[str, str | bool]] = [{"actuation": "current"}]
    options += [{flag: True} for flag in FLAGS]
    options += [{"friction": law} for law in LAWS[1:]]
    known = {f.name for f in fields(MODELS[name])}
    rows = []
    for option in (o for o in options if known >= o.keys()):
        ((key, value),) = option.items()
        model = build(name, **option)
        extra = [row for row in (*model.parameters, *model.states) if row.name not in plain]
        flag = f"`--{key.replace('_', '-')}`" if value is True else f"`--{key} {value}`"
        rows.append([flag, ", ".join(f"`{p.name}` ({p.meaning}, {p.unit})" for p in extra)])
    return table(["option", "adds"], rows)


def model_table() -> str:
    """One line a model."""

    def names(parameters: Iterable[Parameter], fixed: bool) -> str:
        return ", ".join(f"`{p.name}`" for p in parameters if p.fixed is fixed)

    def row(model: Model) -> list[str]:
        signals = [", ".join(n.replace("_", " ") for n in group) for group in (model.state_names, model.input_names)]
        held = names(model.parameters, True)
        return [f"`{model.name}`", model.summary, *signals, names(model.parameters, False), held]

    head = ["model", "what it is", "labels (any of)", "inputs", "estimated", "held unless freed"]
    return table(head, [row(build(name)) for name in MODELS])


def channel_table() -> str:
    """Channels, which are CSV columns and message fields at once, with the topic that carries each."""
    carried = {channel: f"`{t.name}.{field}`" for t in (*RAW, SIGNALS) for field, channel in t.fields.items()}
    rows = [[f"`{s.name}`", s.symbol, s.unit, s.meaning, carried.get(s.name, "-")] for s in CHANNELS.values()]
    return table(["channel", "symbol", "unit", "meaning", "raw topic and field"], rows)


def status_table() -> str:
    """Statuses of a fit with their advice."""
    return table(["status", "what it says"], [[f"`{s.value}`", s.advice] for s in Status])


def commands() -> dict[str, Any]:
    """The commands of `joint-id` by name, as click objects; one of a group is called GROUP-NAME."""
    app.registered_commands = [c for c in app.registered_commands if c.callback not in (record, watch, fleet)]
    app.command("record")(record)  # as the entry points of joint_id_ros do
    app.command("watch")(watch)
    app.command("fleet")(fleet)
    found: dict[str, Any] = dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]  # a group
    for name, group in [(n, c) for n, c in found.items() if hasattr(c, "commands")]:
        found |= {f"{name}-{inner}": command for inner, command in group.commands.items()}
    return found


def command_table(name: str) -> str:
    """Arguments and options of one command."""
    rows = []
    for p in commands()[name].params:
        if p.param_type_name == "argument":
            label, kind, default = p.name.upper(), "required" if p.required else "optional", "-"
        else:
            label = "/".join([*p.opts, *p.secondary_opts])
            kind = "required" if p.required else "repeatable" if p.multiple else "flag" if p.is_flag else "optional"
            value = p.show_default if isinstance(p.show_default, str) else p.default
            default = shown(value) if not p.multiple and value is not False else "-"
        rows.append([f"`{label}`", kind, default, p.help or ""])
    return table(["argument", "kind", "default", "meaning"], rows)


def main() -> None:
    """Rewrite all pages."""
    for page in pages():
        text = page.read_text()
        new = rewrite(text)
        if new != text:
            page.write_text(new)
            print(f"rewritten: {page.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
