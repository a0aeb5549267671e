"""Strict loading of frozen dataclasses: an unknown key is an error that names the nearest one."""

from __future__ import annotations

import dataclasses
import math
import re
import types
import typing
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import yaml

from facetcam.errors import ConfigError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def load_config(cls: type[T], path: Path | str | None) -> T:
    """Read a YAML file of settings into the dataclass `cls`; no file gives its defaults.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, or does not fit `cls` (see `from_mapping`).
    """
    if path is None:
        return cls()
    values = read_yaml(Path(path))
    try:
        return from_mapping(cls, {} if values is None else values, str(path))
    except ConfigError as error:  # a class that checks its own values knows of no file
        raise ConfigError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None


class _StrictLoader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice, and knows 1e-3 for a number as YAML 1.2 does."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        values = super().construct_mapping(node, deep)
        # A key of merged content (<<) may be overridden; only keys written side by side are a mistake.
        if len(values) < len(node.value):
            keys = [key.value for key, _ in node.value]
            again = next((i for i, key in enumerate(keys) if key in keys[:i]), None)
            if again is not None:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {keys[again]!r} given twice", node.value[again][0].start_mark
                )
        return values


_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def read_yaml(path: Path) -> object:
    """Read one YAML document.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, or gives a key twice.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _StrictLoader)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise ConfigError(f"{path}: cannot be read ({reason})") from error
    except (yaml.YAMLError, RecursionError) as error:
        raise ConfigError(f"{path}: not a usable YAML file ({yaml_problem(error)})") from error


def from_mapping(cls: type[T], values: object, where: str) -> T:
    """Build the dataclass `cls` from a mapping of its fields, nested dataclasses included.

    Parameters
    ----------
    cls : type
        A dataclass whose fields are bool, int, float, str, Path, Literal, optional, tuple or dataclass.
    values : mapping
        Field names and values, as read from YAML or given as keywords.
    where : str
        Place named in messages: a file or a function.

    Raises
    ------
    ConfigError
        On an unknown or missing key, a wrong type, or a number that is not finite.
    """
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: expected keys with values, got {_shown(values)}")
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}
    for key in values:
        if key not in fields:
            raise ConfigError(f"{where}: unknown key {key!r}; {nearest(str(key), fields)}")
    hints = typing.get_type_hints(cls)
    known = {key: _convert(hints[key], value, f"{where}: {key}") for key, value in values.items()}
    missing = [f.name for f in fields.values() if f.name not in known and not _has_default(f)]
    if missing:
        raise ConfigError(f"{where}: missing key {missing[0]!r}")
    return cls(**known)


def require_ranges(where: str, settings: object, **ranges: tuple[float, float]) -> None:
    """Raise ConfigError unless each named number, or all of a tuple, lies within its ends; None may."""
    for name, (low, high) in ranges.items():
        found = getattr(settings, name)
        for value in found if isinstance(found, tuple) else (found,):
            if value is not None and not low <= value <= high:
                raise ConfigError(f"{where}: {name} is {value:g}; it must be between {low:g} and {high:g}")


def nearest(word: str, choices: typing.Iterable[str]) -> str:
    """The end of an error line that helps with a misspelt word: the nearest choice, or all of them."""
    choices = list(choices)
    close = get_close_matches(word, choices, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known are {', '.join(sorted(choices))}"


def _has_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING


def _convert(hint: Any, value: object, where: str) -> Any:
    """`value` as the type `hint`, or a ConfigError."""
    origin, choices = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return None if value is None and type(None) in choices else _convert(choices[0], value, where)
    if origin is typing.Literal:
        if value not in choices:
            raise ConfigError(f"{where}: {_shown(value)} is not one of {', '.join(map(repr, choices))}")
        return value
    if origin is tuple:
        return _convert_tuple(choices, value, where)
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return value if isinstance(value, hint) else from_mapping(hint, value, where)
    return _convert_scalar(hint, value, where)


def _convert_tuple(choices: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ConfigError(f"{where}: expected a list, got {_shown(value)}")
    hints = [choices[0]] * len(value) if choices[-1] is Ellipsis else list(choices)
    if len(hints) != len(value):
        raise ConfigError(f"{where}: expected {len(hints)} values, got {len(value)}")
    return tuple(_convert(hint, item, f"{where}[{i}]") for i, (hint, item) in enumerate(zip(hints, value)))


def _convert_scalar(hint: type, value: object, where: str) -> Any:
    """Only lossless conversions: numbers of NumPy, int to float, str to Path; a bool is not a number."""
    if isinstance(value, np.generic):
        value = value.item()
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if hint is Path and isinstance(value, str):
        value = Path(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise ConfigError(f"{where}: expected {hint.__name__}, got {_shown(value)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: must be finite, got {value}")
    return value


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def yaml_problem(error: Exception) -> str:
    """What is wrong in a text of YAML, and where, in one line."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if mark is None or problem is None:
        return " ".join(str(error).split())
    words = f"line {mark.line + 1}, column {mark.column + 1}: {problem}"
    context, start = getattr(error, "context", None), getattr(error, "context_mark", None)
    return words if context is None or start is None else f"{words} {context} from line {start.line + 1}"
