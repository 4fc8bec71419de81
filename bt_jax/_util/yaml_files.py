"""YAML 1.2, read and written by `ruamel.yaml`: `No` is text, 5e-3 a number, 010 is ten, and keys are unique.

Files that nest very deeply, or whose aliases stand for more values than memory holds, are refused before they are built.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, MappingStartEvent, NodeEvent, ScalarEvent
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import SafeRepresenter
from ruamel.yaml.resolver import VersionedResolver

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_text

__all__ = ["parse_yaml", "read_yaml", "to_yaml"]

DEEPEST = 30  # lists and mappings inside each other
LARGEST = 100_000  # values in a file with aliases, those of an alias counted wherever it stands
LONGEST = 1_000_000  # characters
SLOW = 50_000  # characters of which the parser in Python would take more than a second
WIDTH = 120  # columns
TAG = re.compile(r"!|tag:yaml\.org,2002:(str|seq|map)")  # the others may contradict what they stand before
DIGITS = 1000
# What the core schema takes for a number (https://yaml.org/spec/1.2.2, section 10.3.2); the parser knows more, as 1_000.
INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
TEXT = "tag:yaml.org,2002:str"


def read_yaml(path: Path) -> Any:
    """Return what a YAML file holds. Raise UserError, naming file and line, if it is not valid."""
    return parse_yaml(read_text(path), path)


def parse_yaml(text: str, where: object) -> Any:
    """Return what a YAML text holds. Raise UserError, naming `where` it stands and the line, if it is not valid."""
    if len(text) > LONGEST:
        raise UserError(f"{where} has more than {LONGEST:,} characters; give a file that was written for bt_jax")
    with contextlib.suppress(MarkedYAMLError):  # the parser in C refuses some of YAML 1.2, such as {a: 1:30}
        return _parsed(text, where, pure=False)
    try:
        return _parsed(text, where, pure=len(text) < SLOW)
    except MarkedYAMLError as error:
        raise UserError(_sentence(error, text, where)) from None


def _parsed(text: str, where: object, *, pure: bool) -> Any:
    """Return what a text holds, by the parser in C or the one that is purely in Python."""
    try:
        _check(text, where, pure=pure)
        yaml = YAML(typ="safe", pure=pure)
        yaml.Constructor = _Constructor
        return yaml.load(text)
    except MarkedYAMLError:
        raise
    except YAMLError as error:  # a control character
        raise UserError(f"{where} is not valid YAML ({str(error).splitlines()[0]}); correct it") from None
    except (OverflowError, ValueError) as error:  # an escape that stands for no character
        raise UserError(f"{where} is not valid YAML ({error}); correct it") from None


def to_yaml(data: Any) -> str:
    """Return plain data as YAML that readers of YAML 1.1, too, take for the same."""
    yaml, text = YAML(typ="safe"), io.StringIO()
    yaml.Representer = _Representer
    yaml.default_flow_style, yaml.width = None, WIDTH
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    yaml.dump(data, text)
    return text.getvalue()


@dataclasses.dataclass
class _Open:
    """A list or a mapping that is being read. `before`: how many values there were before it; `keys`: the line of each key,
    None in a list; `children`: how many keys and values came so far."""

    before: int
    anchor: str | None
    keys: dict[str, int] | None
    children: int = 0


def _check(text: str, where: object, *, pure: bool) -> None:
    """Raise UserError for what is valid YAML and yet refused: duplicate keys, great depth or size, tags."""
    opened, sizes, total = [_Open(0, None, None)], dict[str, int](), 0
    for event in YAML(typ="safe", pure=pure).parse(text):
        if isinstance(event, CollectionEndEvent):
            closed = opened.pop()
            if closed.anchor is not None:
                sizes[closed.anchor] = total - closed.before
        if not isinstance(event, NodeEvent):
            continue
        line, inside = event.start_mark.line + 1, opened[-1]
        if inside.keys is not None and inside.children % 2 == 0:
            if not isinstance(event, ScalarEvent):
                raise UserError(f"{where}, line {line}: a list or a mapping cannot be a key; write a name")
            if event.value in inside.keys:
                lines = f"{inside.keys[event.value]} and in line {line}"
                raise UserError(f"{where}: the key '{event.value}' stands in line {lines}; remove one of them")
            inside.keys[event.value] = line
        inside.children += 1
        if isinstance(event, AliasEvent):
            if event.anchor in [other.anchor for other in opened]:
                raise UserError(f"{where}, line {line}: the alias {event.anchor} stands inside itself; write it out")
            total += sizes.get(event.anchor, 1)
            if total > LARGEST:
                raise UserError(f"{where}, line {line}: aliases repeat more than {LARGEST:,} values; write them out")
            continue
        total += 1
        if event.tag is not None and not TAG.fullmatch(str(event.tag)):
            raise UserError(f"{where}, line {line}: the tag {event.tag} is not supported; remove it")
        if not isinstance(event, ScalarEvent):
            opened.append(_Open(total - 1, event.anchor, {} if isinstance(event, MappingStartEvent) else None))
            if len(opened) > DEEPEST:
                raise UserError(f"{where}, line {line}: brackets are nested more than {DEEPEST} deep; check them")
        elif event.anchor is not None:
            sizes[event.anchor] = 1


def _sentence(error: MarkedYAMLError, text: str, where: object) -> str:
    """Say what the parser found, and where."""
    mark, began = error.problem_mark or error.context_mark, error.context_mark
    if mark is None:
        return f"{where} is not valid YAML ({error.problem}); correct it"
    problem, lines = error.problem or error.context, text.split("\n")
    if mark.line < len(lines) and lines[mark.line][mark.column : mark.column + 1] == "\t":
        problem = "a tab cannot indent; use spaces"
    elif problem.startswith("but "):  # "expected a single document in the stream", it continues
        problem = f"{error.context} {problem}"
    elif began is not None and began.line != mark.line:
        problem = f"{problem} {error.context} that begins in line {began.line + 1}"
    return f"{where}, line {mark.line + 1} is not valid YAML ({problem}); fix that line"


class _Constructor(SafeConstructor):
    """Builds the core schema of YAML 1.2, which has no dates, no default values and no underscores in numbers."""

    def construct_yaml_int(self, node: ScalarNode) -> int | str:  # type: ignore[override]
        if not INTEGER.fullmatch(node.value):
            return str(node.value)
        if len(node.value) > DIGITS:
            raise MarkedYAMLError(problem=f"a number of more than {DIGITS:,} digits", problem_mark=node.start_mark)
        return int(super().construct_yaml_int(node))

    def construct_yaml_float(self, node: ScalarNode) -> float | str:  # type: ignore[override]
        return float(super().construct_yaml_float(node)) if FLOAT.fullmatch(node.value) else str(node.value)


_Constructor.add_constructor("tag:yaml.org,2002:int", _Constructor.construct_yaml_int)
_Constructor.add_constructor("tag:yaml.org,2002:float", _Constructor.construct_yaml_float)
for tag in ("timestamp", "value"):
    _Constructor.add_constructor(f"tag:yaml.org,2002:{tag}", SafeConstructor.construct_yaml_str)


class _Representer(SafeRepresenter):
    """Writes values such that YAML 1.1, which most other programs read, and 1.2 agree about them."""

    def represent_float(self, value: float) -> ScalarNode:
        node = super().represent_float(value)
        if "e" in node.value and "." not in node.value:
            node.value = node.value.replace("e", ".0e")
        return node

    def represent_str(self, value: str) -> ScalarNode:
        plain = str(_YAML_1_1.resolve(ScalarNode, value, (True, False))) == TEXT
        return self.represent_scalar(TEXT, value, style=None if plain else "'")


_YAML_1_1 = VersionedResolver("1.1")
_Representer.add_representer(float, _Representer.represent_float)
_Representer.add_representer(str, _Representer.represent_str)
