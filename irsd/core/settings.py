"""Declaring settings with their default, range and meaning, and building them from plain mappings.

A stage declares a frozen dataclass whose fields are ``setting(default, doc, ...)`` or, with a default factory, another such;
the config modules read YAML and call ``build``. Nothing is corrected silently: every problem found is reported, each with key,
value and what is allowed.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def setting(
    default: Any,
    doc: str,
    *,
    lo: float | None = None,
    hi: float | None = None,
    choices: tuple[Any, ...] | None = None,
) -> Any:
    """A dataclass field with a range [lo, hi] or choices, and a line of documentation (shown by ``irsctl config``)."""
    metadata = {"doc": doc, "lo": lo, "hi": hi, "choices": choices}
    if isinstance(default, (list, dict, set)):
        raise TypeError("settings are immutable: give a tuple instead of a list")
    return dataclasses.field(default=default, metadata=metadata)


def build(cls: type[T], values: Mapping[str, Any], *, path: str = "") -> tuple[T | None, list[str]]:
    """The settings object from a plain mapping, and every problem found (empty when the object is good).

    path: the dotted key of this section, used in messages such as ``fusion.tau_g = 1.4: must be in 0 .. 1``.
    """
    if not isinstance(values, Mapping):
        return None, [f"{path or '(top level)'} = {values!r}: must be a section of keys and values"]
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    problems = [
        f"{_join(path, str(key))} = {value!r}: unknown key; known here: {', '.join(sorted(fields))}"
        for key, value in values.items()
        if key not in fields
    ]
    arguments: dict[str, Any] = {}
    for name, field in fields.items():
        if name not in values:
            continue
        key, wanted = _join(path, name), hints[name]
        if dataclasses.is_dataclass(wanted):
            arguments[name], found = build(typing.cast(type[Any], wanted), values[name] or {}, path=key)
        else:
            arguments[name], found = _checked(key, values[name], wanted, field.metadata)
        problems += found
    return (None if problems else cls(**arguments)), problems


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _checked(key: str, value: Any, wanted: Any, metadata: Mapping[str, Any]) -> tuple[Any, list[str]]:
    """The value in the declared type, or the problem with it."""
    converted, ok = _convert(value, wanted)
    if not ok:
        return None, [f"{key} = {value!r}: must be {_name_of(wanted)}"]
    choices, lo, hi = metadata.get("choices"), metadata.get("lo"), metadata.get("hi")
    if choices is not None and converted not in choices:
        return None, [f"{key} = {value!r}: must be one of {', '.join(map(str, choices))}"]
    numbers = converted if isinstance(converted, tuple) else (converted,)
    for number in numbers:
        if not isinstance(number, (int, float)) or isinstance(number, bool):
            continue
        if (lo is not None and not number >= lo) or (hi is not None and not number <= hi):
            low, high = "-inf" if lo is None else lo, "inf" if hi is None else hi
            return None, [f"{key} = {value!r}: must be in {low} .. {high}"]
    return converted, []


def _convert(value: Any, wanted: Any) -> tuple[Any, bool]:
    """(value as the declared type, whether it fits). Integers pass as floats; nothing else is converted."""
    origin = typing.get_origin(wanted)
    if origin in (types.UnionType, typing.Union):
        tries = (_convert(value, option) for option in typing.get_args(wanted))
        return next(((got, True) for got, ok in tries if ok), (None, False))
    if origin is tuple:
        inner = typing.get_args(wanted)[0]
        if not isinstance(value, (list, tuple)):
            return None, False
        items = [_convert(item, inner) for item in value]
        return tuple(item for item, _ in items), all(ok for _, ok in items)
    if origin in (dict, Mapping) or wanted is dict:
        return value, isinstance(value, Mapping)
    if wanted is float:
        return (
            (float(value), True) if isinstance(value, (int, float)) and not isinstance(value, bool) else (None, False)
        )
    if wanted is int:
        return value, isinstance(value, int) and not isinstance(value, bool)
    if wanted is type(None):
        return None, value is None
    return value, isinstance(value, wanted)


def _name_of(wanted: Any) -> str:
    names = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}
    if typing.get_origin(wanted) is tuple:
        return f"a list ({_name_of(typing.get_args(wanted)[0])} each)"
    return names.get(wanted, str(wanted))
