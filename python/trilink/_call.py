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
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeVar

from . import _trilink
from ._errors import Caution
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
    return typing.cast(T, _dataclass(kind, json.loads(text), others))


def list_from_json(kind: type[T], text: str) -> list[T]:
    """Converts a JSON array to a list of dataclasses."""
    return [typing.cast(T, _dataclass(kind, item)) for item in json.loads(text)]


def _dataclass(kind: object, value: dict[str, object], others: Mapping[str, object] = {}) -> object:
    """Converts a JSON object to a dataclass. The metadata `json` of a field is its key, if that is another name."""
    fields = {}
    for name, (key, hint) in _fields(typing.cast(type, kind)).items():
        if key in value:
            fields[name] = _convert(hint, value[key])
    return typing.cast(type, kind)(**fields, **others)


@functools.cache
def _fields(kind: type) -> dict[str, tuple[str, object]]:
    """Returns the key in JSON and the type of each field of a dataclass."""
    hints = typing.get_type_hints(kind)
    fields = dataclasses.fields(kind)
    return {
        field.name: (field.metadata.get("json", field.name), hints[field.name]) for field in fields
    }


def _convert(kind: object, value: object) -> object:
    """Converts a JSON value to a type; a missing number (null) is NaN where the type has no None."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind) and isinstance(value, dict):
        return _dataclass(kind, value)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _convert(arguments[0], value)
    if kind is float and value is None:
        return float("nan")
    if kind is Path:
        return Path(str(value))
    if origin in (list, tuple) and isinstance(value, list):
        return origin(_convert(arguments[0], item) for item in value)
    return value
