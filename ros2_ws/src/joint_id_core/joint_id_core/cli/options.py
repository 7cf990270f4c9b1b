"""Generate command-line options from options dataclasses, so that defaults and help texts exist only once."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Sequence
from dataclasses import MISSING, Field, fields
from typing import Annotated, Any, Optional, get_type_hints

import typer

from joint_id_core.options import names


def with_options(
    argument: str, kinds: Sequence[type], only: Collection[str] = (), no_default: Collection[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds one option for every field of these dataclasses, or only for the fields in `only`.

    The command receives the options that the user gave as a dictionary, in its parameter `argument`. A field that
    several dataclasses have becomes one option. For those in `no_default` the command finds a value itself.
    """
    chosen: dict[str, list[tuple[type, Field[Any]]]] = {}
    for kind in kinds:
        for f in fields(kind):
            if not only or f.name in only:
                chosen.setdefault(f.name, []).append((kind, f))

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def called(**arguments: Any) -> None:
            given = {name: value for name in chosen if (value := arguments.pop(name)) is not None}
            command(**arguments, **{argument: given})

        made = [_parameter(name, group, name in no_default, len(kinds) > 1) for name, group in chosen.items()]
        return _signed(called, command, argument, made)

    return decorate


def with_group(argument: str, group: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds one option for every field of a dataclass, whose annotations are those of typer.

    The command receives the group in its parameter `argument`.
    """
    members = {f.name: f.default for f in fields(group)}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def called(**arguments: Any) -> None:
            given = {name: arguments.pop(name) for name in members}
            command(**arguments, **{argument: group(**given)})

        hints, kind = get_type_hints(group, include_extras=True), inspect.Parameter.POSITIONAL_OR_KEYWORD
        made = [inspect.Parameter(n, kind, default=d, annotation=hints[n]) for n, d in members.items()]
        return _signed(called, command, argument, made)

    return decorate


def completed(choices: Sequence[str]) -> Callable[[str], list[str]]:
    """Return what the shell asks for the values of an option when the tab key is pressed."""

    def complete(incomplete: str) -> list[str]:
        return [choice for choice in choices if choice.startswith(incomplete)]

    return complete


def _signed(
    called: Callable[..., None], command: Callable[..., None], argument: str, made: Sequence[inspect.Parameter]
) -> Callable[..., None]:
    """Return a function with the parameters of a command, of which those that were made replace `argument`."""
    signature, hints = inspect.signature(command), get_type_hints(command, include_extras=True)
    parameters: list[inspect.Parameter] = []
    for name, own in signature.parameters.items():
        parameters += made if name == argument else [own.replace(annotation=hints[name])]
    ordered = sorted(parameters, key=lambda p: p.default is not inspect.Parameter.empty)
    called.__signature__ = signature.replace(parameters=ordered)  # type: ignore[attr-defined]  # typer reads it
    called.__annotations__ = {p.name: p.annotation for p in ordered} | {"return": None}
    return called


def _parameter(name: str, group: list[tuple[type, Field[Any]]], no_default: bool, tell_kind: bool) -> inspect.Parameter:
    """Return the command's parameter for one field."""
    said = []
    for kind, f in group:
        text = f.metadata["description"]
        if choices := f.metadata.get("choices"):
            text += f" ({names(tuple(c for c in choices if c))})"
        if unit := f.metadata.get("unit"):
            text += f" [{unit}]"
        said.append(f"{getattr(kind, 'name', '')}: {text}" if tell_kind else text)
    default, decl = group[0][1].default, f"--{name.replace('_', '-')}"
    shown = False if default is MISSING or default in ("", False) or no_default else str(default)
    choices = tuple(dict.fromkeys(c for _, f in group for c in f.metadata.get("choices") or () if c))
    # without choices the shell completes file names
    settings = typer.Option(
        decl, help="; ".join(said), show_default=shown, autocompletion=completed(choices) if choices else None
    )
    annotation = Annotated[Optional[type(default)], settings]  # type: ignore[valid-type]  # of a field
    return inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)
