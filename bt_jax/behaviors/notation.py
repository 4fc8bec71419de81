"""The notation of leaves and of trees on one line, for instance `Sequence(gripper(open), pick(YellowBox))`: its one reader.

`#` starts a comment. Inside parentheses, lines may break anywhere.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Callable
from typing import NoReturn, TypeVar

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Control, Kind
from bt_jax.behaviors.symbols import SIGNATURES, Argument, Behavior, Tree

__all__ = ["CONTROLS", "Parser", "Token", "parse_behavior"]

CONTROLS = {"Sequence": Kind.SEQUENCE, "Fallback": Kind.FALLBACK}
Item = TypeVar("Item")


def parse_behavior(text: str) -> Behavior:
    """Read what `str(behavior)` writes. Raise UserError, with line, column and remedy, if it is not one behavior."""
    parser = Parser(text)
    try:
        node = None if parser.at_end else parser.node()
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
        raise UserError(f"line {self.line}, column {self.column}: {problem}")


_TOKEN = re.compile(
    r"(?P<skip>[ \r]+|#[^\n]*)|(?P<newline>\n)|[^\W\d][\w.-]*|[+-]?[\d.][\w.]*(?:(?<=[eE])[+-]\d+)?|[(),]"
)
_NAME = re.compile(r"[^\W\d]")


def _tokens(text: str) -> list[Token]:
    tokens: list[Token] = []
    line, line_start, at, nesting, fresh = 1, 0, 0, 0, True
    while at < len(text):
        column = at - line_start + 1
        match = _TOKEN.match(text, at)
        if not match:
            found = Token(text[at], line, column, None)
            found.fail("found a tab; use spaces" if text[at] == "\t" else f"unexpected '{text[at]}'; delete it")
        if match["newline"]:
            line, line_start, fresh = line + 1, match.end(), nesting == 0
        elif not match["skip"]:
            tokens.append(Token(match[0], line, column, column - 1 if fresh else None))
            fresh = False
            nesting = max(0, nesting + (match[0] == "(") - (match[0] == ")"))
        at = match.end()
    return tokens


class Parser:
    """Reads a text node by node; `at` is the index of the next token."""

    def __init__(self, text: str) -> None:
        self.tokens = _tokens(text)
        self.at = 0

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
        name = self.next()
        if not _NAME.match(name.text):
            name.fail(f"found '{name.text}' where a node should be; write a name such as Sequence or pick(YellowBox)")
        if name.text not in CONTROLS and name.text not in SIGNATURES:
            _unknown(name)
        if name.text in CONTROLS:
            nodes = self.items(self.node)
            if not nodes:
                name.fail(f"{name.text} has no children; add some or delete it")
            return Control(CONTROLS[name.text], tuple(nodes))
        wanted = iter(SIGNATURES[name.text].arguments)

        def argument() -> Argument:
            return self.node() if next(wanted, None) == "tree" else self.argument()

        arguments = tuple(self.items(argument))
        try:
            return Behavior(name.text, arguments)
        except UserError as error:
            name.fail(str(error))

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

    def number(self) -> float:
        token = self.next()
        try:
            value = float(token.text) + 0.0
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            token.fail(f"'{token.text}' is not a number; write positions in metres, as (0, 0, 0.1)")
        return value


def _unknown(name: Token) -> NoReturn:
    known = [*CONTROLS, *SIGNATURES]
    close = difflib.get_close_matches(name.text, known, n=1)
    remedy = f"did you mean {close[0]}?" if close else f"use one of {', '.join(known)}"
    name.fail(f"unknown node '{name.text}'; {remedy}")
