"""Calls of the program's commands, and conversion of their results."""

from __future__ import annotations

import dataclasses
import functools
import json
import logging
import os
import sys
import types
import typing
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from . import _trilink
from ._errors import Caution, ConfigError
from ._table import Table

Pathlike = str | os.PathLike[str]
Numbers = float | Iterable[float]
Option = None | bool | float | str | os.PathLike[str] | Iterable[str]

T = TypeVar("T")
_log = logging.getLogger("trilink")


@dataclasses.dataclass(frozen=True)
class Returned:
    """Result of a command."""

    needs_attention: bool
    json: str
    tables: Mapping[str, Table]


def call(
    command: str,
    *operands: Pathlike,
    config: Pathlike | None = None,
    progress: bool | None = None,
    settings: Mapping[str, Numbers] | None = None,
    **options: Option,
) -> Returned:
    """Calls a command. An option that is None or False is left out, and one with several texts is repeated."""
    line = ["trilink", command]
    if config is not None:
        line += ["--config", os.fspath(config)]
    for name, option in options.items():
        flag = "--" + name.rstrip("_").replace("_", "-")
        option = plain(option)
        if option is True:
            line.append(flag)
        elif option is not None and option is not False:
            line += [f"{flag}={text}" for text in _texts(option)]
    line += [f"--set={name}={numbers(value)}" for name, value in (settings or {}).items()]
    line += ["--", *(os.fspath(operand) for operand in operands)]
    is_terminal = getattr(sys.stderr, "isatty", lambda: False)()
    shown = is_terminal if progress is None else progress
    style = "" if not shown else "bars" if is_terminal else "lines"
    needs_attention, text, tables, notes, cautions = _trilink.call(line, style)
    for note in notes:
        _log.info(note)
    for message in cautions:
        caution(message)
    return Returned(needs_attention, text, {name: Table(access) for name, access in tables})


def caution(message: str) -> None:
    """Issues a warning at the line that calls the package."""
    frame: types.FrameType | None = sys._getframe()
    level = 1
    while frame is not None and frame.f_globals.get("__package__") == __package__:
        frame = frame.f_back
        level += 1
    warnings.warn(message, Caution, stacklevel=level)


def _texts(option: Option) -> list[str]:
    """Returns the values of an option, one for each time that it is repeated."""
    if isinstance(option, (str, os.PathLike)):
        return [os.fspath(option)]
    if isinstance(option, Iterable):
        return list(option)
    return [str(option) if isinstance(option, int) else repr(option)]


def numbers(value: Numbers) -> str:
    """Writes one or several numbers, with all digits, as on the command line."""
    value = plain(value)
    parts = value if isinstance(value, Iterable) else [value]
    if isinstance(value, str) or not all(hasattr(part, "__float__") for part in parts):
        raise ConfigError(f"found {value!r}, needed a number or several numbers")
    return ",".join(repr(float(part)) for part in parts)


def interval(value: float | tuple[float, float] | None) -> str | None:
    """Writes a range as on the command line; a single number fixes a quantity."""
    if isinstance(value, tuple):
        return "..".join(map(numbers, value))
    return None if value is None else numbers(value)


def plain(value: T) -> T:
    """Converts NumPy numbers and arrays to Python numbers and lists."""
    return typing.cast(T, value.tolist()) if hasattr(value, "tolist") else value


def from_json(kind: type[T], text: str, **others: object) -> T:
    """Converts JSON to a dataclass, of which `others` are further fields."""
    return kind(**_fields(typing.cast(type, kind))(json.loads(text)), **others)


def list_from_json(kind: type[T], text: str) -> list[T]:
    """Converts a JSON array to a list of dataclasses."""
    fields = _fields(typing.cast(type, kind))
    return [kind(**fields(item)) for item in json.loads(text)]


@functools.cache
def _fields(kind: type) -> Callable[[dict[str, object]], dict[str, object]]:
    """Returns a function that converts a JSON object to the fields of a dataclass. The metadata `json` of a field is
    its key, if that is another name."""
    hints = typing.get_type_hints(kind)
    fields = [
        (field.name, field.metadata.get("json", field.name), _converter(hints[field.name]))
        for field in dataclasses.fields(kind)
    ]
    return lambda value: {
        name: convert(value[key]) for name, key, convert in fields if key in value
    }


def _converter(kind: object) -> Callable[[Any], object]:
    """Returns a function that converts a JSON value to a type; a missing number (null) is NaN where the type has no
    None."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        fields = _fields(kind)
        return lambda value: kind(**fields(value))
    if origin in (typing.Union, types.UnionType):
        inner = _converter(arguments[0])
        return lambda value: None if value is None else inner(value)
    if origin in (list, tuple):
        inner = _converter(arguments[0])
        return lambda value: origin(map(inner, value))
    if kind is float:
        return lambda value: float("nan") if value is None else value
    return Path if kind is Path else lambda value: value
