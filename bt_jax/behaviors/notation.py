"""The notation of leaves and of trees on one line, for instance `Sequence(gripper(open), pick(YellowBox))`: its one reader.

A node that needs a number has it first: `Timeout(5000, pick(YellowBox))`. `#` starts a comment. Inside parentheses, lines
may break anywhere. What word processors make of spaces and minus signs is read as what it stands for.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import unicodedata
from collections.abc import Callable
from typing import NoReturn, TypeVar

from bt_jax._util.errors import UserError
from bt_jax._util.words import clipped, listed
from bt_jax.behaviors.nodes import EXTENDED, Control, ExtendedNode, Kind
from bt_jax.behaviors.symbols import SIGNATURES, Argument, Behavior, Tree

__all__ = ["CONTROLS", "Parser", "Token", "inner_node", "parse_behavior", "plain"]

CONTROLS = {"Sequence": Kind.SEQUENCE, "Fallback": Kind.FALLBACK}
Item = TypeVar("Item")
UNKNOWN = Behavior("open_gripper")  # stands for an unknown node until all of them are known
INSTEAD = {
    "ReactiveSequence": "Sequence, which is reactive here",
    "ReactiveFallback": "Fallback, which is reactive here",
    "Selector": "Fallback",
    "Retry": "retry, or RetryUntilSuccessful, which tries again within one tick",
}


def parse_behavior(text: str) -> Behavior:
    """Read what `str(behavior)` writes. Raise UserError, with line, column and remedy, if it is not one behavior."""
    parser = Parser(text)
    try:
        node = None if parser.at_end else parser.node()
        parser.refuse_unknown()
    except RecursionError:
        raise UserError("the behavior is nested too deeply; make it flatter") from None
    if not isinstance(node, Behavior) or not parser.at_end:
        raise UserError(f"'{text.strip()}' is not a behavior; write name(arguments), for instance pick(YellowBox)")
    return node


@dataclasses.dataclass(frozen=True)
class Token:
    """A piece of text and where it is; `indent` is the indentation of the line that it begins, None inside a line."""

    text: str
    line: int
    column: int
    indent: int | None

    def fail(self, problem: str) -> NoReturn:
        raise UserError(clipped(f"line {self.line}, column {self.column}: {problem}"))


_TOKEN = re.compile(
    r"(?P<skip>[ \r]+|#[^\n]*)|(?P<newline>\n)|[^\W\d][\w.-]*|[+-]?[\d.][\w.]*(?:(?<=[eE])[+-]\d+)?|[(),]"
)
_NAME = re.compile(r"[^\W\d]")
_NUMBER = re.compile(r"[+-]?[\d.]")
# Each stands for one character, so that columns stay.
_SPACES = "\u00a0\u2002\u2003\u2007\u2009\u200b\u202f\u3000\ufeff"
_MINUS_SIGNS = "\u2010\u2011\u2012\u2013\u2212"
_LOOKALIKES = str.maketrans({**dict.fromkeys(_SPACES, " "), **dict.fromkeys(_MINUS_SIGNS, "-")})
_QUOTES = "\"'`\u201c\u201d\u201e\u2018\u2019\u201a\u00ab\u00bb"


def plain(text: str) -> str:
    """Return a text with the spaces and minus signs of typesetters as ASCII, and without a byte order mark."""
    return text.removeprefix("\ufeff").translate(_LOOKALIKES)


def _tokens(text: str) -> list[Token]:
    text = plain(text)
    tokens: list[Token] = []
    line, line_start, at, nesting, fresh = 1, 0, 0, 0, True
    while at < len(text):
        column = at - line_start + 1
        match = _TOKEN.match(text, at)
        if not match:
            found = Token(text[at], line, column, None)
            found.fail(_unexpected(text[at]))
        if match["newline"]:
            line, line_start, fresh = line + 1, match.end(), nesting == 0
        elif not match["skip"]:
            tokens.append(Token(match[0], line, column, column - 1 if fresh else None))
            fresh = False
            nesting = max(0, nesting + (match[0] == "(") - (match[0] == ")"))
        at = match.end()
    return tokens


def _unexpected(character: str) -> str:
    """Say what is wrong with a character that begins no token."""
    if character == "\t":
        return "found a tab; use spaces"
    shown = (
        repr(character) if character.isascii() else f"{character!r} ({unicodedata.name(character, 'unnamed').lower()})"
    )
    return f"unexpected {shown}; {'names need no quotation marks, ' if character in _QUOTES else ''}delete it"


def inner_node(name: Token, nodes: list[Tree], number: int | None) -> Tree:
    """Return the node of that name over its children. Raise UserError, with line and column, if they do not fit."""
    if name.text in CONTROLS:
        if number is not None:
            name.fail(f"{name.text} takes no number; delete {number}")
        if not nodes:
            name.fail(f"{name.text} has no children; add some or delete it")
        return Control(CONTROLS[name.text], tuple(nodes))
    try:
        return ExtendedNode(name.text, tuple(nodes), number)
    except UserError as error:
        name.fail(str(error))


class Parser:
    """Reads a text node by node; `at` is the index of the next token. Unknown nodes are collected and refused together."""

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(text)
        self.at = 0
        self.unknown: list[Token] = []

    def refuse_unknown(self) -> None:
        """Raise UserError, with the line of each, if nodes were unknown."""
        if not self.unknown:
            return
        first, rest = self.unknown[0], self.unknown[1:]
        known = [*CONTROLS, *EXTENDED, *SIGNATURES]
        if not rest:
            close = difflib.get_close_matches(first.text, known, n=1)
            remedy = f"did you mean {close[0]}?" if close else f"use one of {', '.join(known)}"
            if first.text in INSTEAD:
                remedy = f"use {INSTEAD[first.text]}"
            first.fail(f"unknown node '{first.text}'; {remedy}")
        others = listed([f"'{name.text}' (line {name.line})" for name in rest])
        first.fail(f"unknown nodes '{first.text}', {others}; use {', '.join(known)}")

    def skip_unknown(self) -> Tree:
        """Remember an unknown node and return what stands for it; what is in its parentheses is not read."""
        self.unknown.append(self.next())
        nesting = 0
        while not self.at_end and (nesting or self.peek("(")):
            text = self.next().text
            nesting += (text == "(") - (text == ")")
        return UNKNOWN

    def known(self) -> bool:
        """Is the next token the name of a node?"""
        return self.tokens[self.at].text in CONTROLS.keys() | EXTENDED.keys() | SIGNATURES.keys()

    @property
    def at_end(self) -> bool:
        return self.at == len(self.tokens)

    def peek(self, text: str) -> bool:
        """Is the next token `text`, and on the same logical line?"""
        return not self.at_end and self.tokens[self.at].text == text and self.tokens[self.at].indent is None

    def next(self) -> Token:
        self.at += 1
        return self.tokens[self.at - 1]

    def node(self) -> Tree:
        """`name` or `name(...)` on one logical line."""
        name = self.tokens[self.at]
        if not self.at_name():
            name.fail(f"found '{name.text}' where a node should be; write a name such as Sequence or pick(YellowBox)")
        if not self.known():
            return self.skip_unknown()
        self.next()
        if name.text not in SIGNATURES:
            parts = self.items(self.part)
            numbers = [part for part in parts if isinstance(part, int)]
            if numbers != [part for part in parts[:1] if isinstance(part, int)]:
                name.fail(f"{name.text} takes one number, before its children; write it there, or delete {numbers[-1]}")
            return inner_node(name, [part for part in parts if not isinstance(part, int)], next(iter(numbers), None))
        wanted = iter(SIGNATURES[name.text].arguments + SIGNATURES[name.text].optional)

        def argument() -> Argument:
            match next(wanted, None):
                case "tree":
                    return self.node()
                case "turn" if self.at_number():
                    return self.number("a turn in degrees, as 90")
            return self.argument()

        arguments = tuple(self.items(argument))
        try:
            return Behavior(name.text, arguments)
        except UserError as error:
            name.fail(str(error))

    def at_name(self) -> bool:
        """Is the next token a name?"""
        return _NAME.match(self.tokens[self.at].text) is not None

    def part(self) -> Tree | int:
        """A child, or the number of a node."""
        return self.count() if self.at_number() else self.node()

    def at_number(self) -> bool:
        """Is the next token a number, or the beginning of one?"""
        return not self.at_end and _NUMBER.match(self.tokens[self.at].text) is not None

    def count(self) -> int:
        """A whole number."""
        token = self.next()
        try:
            return int(token.text)
        except ValueError:
            token.fail(f"'{token.text}' is not a whole number; write one, as in Timeout(5000, ...)")

    def items(self, read: Callable[[], Item]) -> list[Item]:
        """Return what stands in parentheses, separated by commas; nothing where no parenthesis follows."""
        if not self.peek("("):
            return []
        opening = self.next()
        found: list[Item] = []
        while not self.peek(")"):
            if self.at_end:
                opening.fail("this '(' is never closed; add ')'")
            found.append(read())
            if self.at_end:
                opening.fail("this '(' is never closed; add ')'")
            if not self.peek(")"):
                comma = self.next()
                if comma.text != ",":
                    comma.fail(f"found '{comma.text}' where ',' or ')' should be; add it")
                if self.peek(")"):
                    comma.fail("nothing follows this ','; delete it")
        self.next()
        return found

    def argument(self) -> str | tuple[float, float, float]:
        if not self.peek("("):
            token = self.next()
            if not _NAME.match(token.text):
                token.fail(f"found '{token.text}' where a name should be; write positions as (0, 0, 0.1)")
            return token.text
        opening = self.tokens[self.at]
        numbers = self.items(self.number)
        if len(numbers) != 3:
            opening.fail(f"a position has three numbers, found {len(numbers)}; write it in metres, as (0, 0, 0.1)")
        x, y, z = numbers
        return x, y, z

    def number(self, remedy: str = "positions in metres, as (0, 0, 0.1)") -> float:
        token = self.next()
        try:
            value = float(token.text) + 0.0
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            token.fail(f"'{token.text}' is not a number; write {remedy}")
        return value
