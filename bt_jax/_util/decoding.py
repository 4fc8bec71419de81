"""Plain data, as YAML and JSON files hold it, to typed values. `msgspec` builds them and says which scalar has which type;
what does not fit is described in one sentence that names the file and the key."""

from __future__ import annotations

import dataclasses
import difflib
import enum
import functools
import math
import reprlib
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, Literal, TypeVar

import msgspec

from bt_jax._util.errors import UserError

__all__ = ["abridged", "decode"]

T = TypeVar("T")
Problem = tuple[str, str]  # key, what is wrong with its value

SCALARS: Mapping[Any, tuple[str, str]] = types.MappingProxyType(
    {  # type -> what it is called, how to write it
        bool: ("true or false", "one of them"),
        int: ("a whole number", "one such as 10"),
        float: ("a number", "one such as 0.05"),
        str: ("text", "one such as YellowBox"),
        types.NoneType: ("null", "null"),
    }
)
EXAMPLE = (0.1, 0, 0.05, 1)
COUNTS = {2: "two", 3: "three", 4: "four"}
LONGEST = 60  # characters of a value in an error
NO_EXAMPLES: Mapping[str, str] = types.MappingProxyType({})


def decode(data: Any, kind: type[T], source: object, *, key: str = "", examples: Mapping[str, str] = NO_EXAMPLES) -> T:
    """Return plain data as a value of a type: dataclasses, lists, tuples, mappings, enums, choices, numbers, text.

    Raise UserError, naming `source` (a file) and the key, which begins with `key`, for a key that is missing or unknown, a
    value of another type or a number that is not finite. `examples` says for a key that is missing what to write.
    """
    problem = next(_problems(data, kind, key, examples), None)
    if problem is None:
        try:
            return msgspec.convert(data, kind)
        except msgspec.ValidationError as error:  # of a dataclass that checks itself
            problem = key, str(error)
    where, text = problem
    raise UserError(f"{source}, key {where}: {text}" if where else f"{source}: {text}")


def abridged(value: Any) -> str:
    """Return a value as an error shows it: on one line, not too long, and as YAML and JSON write it."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = value.isoformat() if hasattr(value, "isoformat") else _SHORT.repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 2, LONGEST, LONGEST


def _problems(data: Any, kind: Any, key: str, examples: Mapping[str, str]) -> Iterator[Problem]:
    """Yield the keys whose values do not have their types."""
    kind = _alternative(data, kind)
    if not _fits(data, kind):
        yield key, _expectation(data, kind)
        return
    if dataclasses.is_dataclass(kind):
        fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
        for name in data:
            if name not in fields:
                known = [_written(field) for field in fields.values()]
                near = difflib.get_close_matches(str(name), known, n=1)
                remedy = f"did you mean {near[0]}?" if near else f"use one of {', '.join(known)}"
                yield _below(key, name), f"not known here; {remedy}"
        for name, field in fields.items():
            required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
            if required and name not in data:
                example = f", for instance {name}: {examples[name]}" if name in examples else ""
                yield _below(key, name), f"missing; add it{example}"
    for where, item, of in _items(data, kind, key):
        yield from _problems(item, of, where, examples)


def _alternative(data: Any, kind: Any) -> Any:
    """Return the member of a union that data fits at first sight; the type itself if it is no union or none fits."""
    if typing.get_origin(kind) not in (typing.Union, types.UnionType):
        return kind
    return next((member for member in typing.get_args(kind) if _fits(data, member)), kind)


def _fits(data: Any, kind: Any) -> bool:
    """Return whether data has a type at first sight: lists and mappings are not looked into."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind) or origin in (dict, Mapping):
        return isinstance(data, Mapping)
    if origin in (list, tuple):
        return isinstance(data, list | tuple) and (
            origin is list or arguments[-1] is ... or len(data) == len(arguments)
        )
    try:
        value = msgspec.convert(data, kind)
    except (msgspec.ValidationError, OverflowError):
        return False
    return not isinstance(value, float) or math.isfinite(value)


def _items(data: Any, kind: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield key, value and type of what a list or a mapping holds; its type is one that data fits at first sight."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        types_of = _hints(kind)  # type: ignore[arg-type]  # mypy takes every dataclass for an instance
        names = {field.name: _written(field) for field in dataclasses.fields(kind)}
        yield from ((_below(key, names[name]), value, types_of[name]) for name, value in data.items())
    elif origin in (dict, Mapping):
        for name, value in data.items():
            yield f"{_below(key, name)} itself", name, arguments[0]
            yield _below(key, name), value, arguments[1]
    elif origin in (list, tuple):
        of = [arguments[0]] * len(data) if origin is list or arguments[-1] is ... else arguments
        yield from ((f"{key}[{i}]", value, of[i]) for i, value in enumerate(data))


@functools.cache
def _hints(kind: Any) -> Mapping[str, Any]:
    return typing.get_type_hints(kind)


def _written(field: dataclasses.Field[Any]) -> str:
    """Return what files call a field: `written` in its metadata where that is a keyword of Python, else its name."""
    return field.metadata.get("written", field.name)


def _below(key: str, name: Any) -> str:
    return f"{key}.{name}" if key else str(name)


def _expectation(data: Any, kind: Any) -> str:
    """Say what is expected and found, and how to write it."""
    name, example = _named(kind)
    unquoted = kind is str and not isinstance(data, list | tuple | Mapping | None)
    remedy = f"put it in quotes: '{abridged(data)}'" if unquoted else f"write {example}"
    return f"expected {name}, found {abridged(data)}; {remedy}"


def _named(kind: Any) -> tuple[str, str]:
    """Return what a type is called, and how to write a value of it."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind in SCALARS:
        return SCALARS[kind]
    if dataclasses.is_dataclass(kind):
        return "a mapping", f"keys such as {', '.join(field.name for field in dataclasses.fields(kind)[:3])}"
    if origin in (dict, Mapping):
        return "a mapping", "one 'key: value' line for each"
    if origin is list or arguments[-1:] == (...,):
        names = arguments[0] is str
        return ("a list of names", "a list such as [YellowBox]") if names else ("a list", "one '- ' entry for each")
    if origin is tuple:
        return f"{COUNTS[len(arguments)]} numbers", f"a list such as {list(EXAMPLE[: len(arguments)])}"
    if origin is Literal or (isinstance(kind, type) and issubclass(kind, enum.Enum)):
        choices = arguments or [member.value for member in kind]
        return f"one of {', '.join(map(str, choices))}", f"one such as {choices[0]}"
    return " or ".join(_named(member)[0] for member in arguments), _named(arguments[0])[1]
