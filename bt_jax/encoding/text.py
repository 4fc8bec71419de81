"""Trees as text that people read and write: one node a line, children indented under their parent.

    Sequence
      move(YellowBox, (0, 0, 0.055), KittingBox)
      Fallback
        gripper(open)
        open_gripper

On one line: `Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), Fallback(gripper(open), open_gripper))`. Both forms
mix: a line may hold a whole subtree in parentheses, and inside parentheses lines may break anywhere. A subtask holds its
tree: `subtask(unstack, Sequence(...))`. `#` starts a comment.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Callable
from typing import NoReturn, TypeVar

from bt_jax.behaviors import SIGNATURES, Behavior, Control, Kind, Tree
from bt_jax.encoding.walk import children
from bt_jax.errors import UserError

__all__ = ["format_tree", "one_line", "parse_tree"]

CONTROLS = {"Sequence": Kind.SEQUENCE, "Fallback": Kind.FALLBACK}
NAMES = {kind: name for name, kind in CONTROLS.items()}
INDENT = 2
Item = TypeVar("Item")


def format_tree(tree: Tree) -> str:
    """One node a line, indented by depth, ends with a newline. `parse_tree` reads it back to an equal tree."""
    lines: list[str] = []

    def visit(node: Tree, depth: int) -> None:
        name = NAMES[node.kind] if isinstance(node, Control) else str(node)
        lines.append(" " * (INDENT * depth) + name)
        for child in children(node):
            visit(child, depth + 1)

    visit(tree, 0)
    return "\n".join(lines) + "\n"


def one_line(tree: Tree) -> str:
    """The tree on one line, children in parentheses. `parse_tree` reads it back to an equal tree."""
    return str(tree)


def parse_tree(text: str) -> Tree:
    """Reads what `format_tree` and `one_line` write.

    Raises UserError, with line, column and remedy, where the text is not one tree.
    """
    parser = _Parser(_tokens(text))
    if parser.at_end:
        raise UserError("the text holds no tree; write at least one node, for instance pick(YellowBox)")
    try:
        return parser.tree()
    except RecursionError:
        raise UserError("the tree is nested too deeply; make it flatter") from None


@dataclasses.dataclass(frozen=True)
class _Token:
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


def _tokens(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    line, line_start, at, nesting, fresh = 1, 0, 0, 0, True
    while at < len(text):
        column = at - line_start + 1
        match = _TOKEN.match(text, at)
        if not match:
            found = _Token(text[at], line, column, None)
            found.fail("a tab is found; use spaces" if text[at] == "\t" else f"'{text[at]}' means nothing; delete it")
        if match["newline"]:
            line, line_start, fresh = line + 1, match.end(), nesting == 0
        elif not match["skip"]:
            tokens.append(_Token(match[0], line, column, column - 1 if fresh else None))
            fresh = False
            nesting = max(0, nesting + (match[0] == "(") - (match[0] == ")"))
        at = match.end()
    return tokens


@dataclasses.dataclass
class _Open:
    """A control node whose children are still being read, from the lines below it."""

    token: _Token
    children: list[Tree | _Open]


class _Parser:
    def __init__(self, tokens: list[_Token]):
        self.tokens = tokens
        self.at = 0

    @property
    def at_end(self) -> bool:
        return self.at == len(self.tokens)

    def peek(self, text: str) -> bool:
        """Is the next token `text`, and on the same logical line?"""
        return not self.at_end and self.tokens[self.at].text == text and self.tokens[self.at].indent is None

    def next(self) -> _Token:
        self.at += 1
        return self.tokens[self.at - 1]

    def tree(self) -> Tree:
        """The lines, nested by their indentation."""
        root: Tree | _Open | None = None
        path: list[tuple[int, Tree | _Open]] = []
        while not self.at_end:
            first = self.tokens[self.at]
            node = self.line()
            assert first.indent is not None
            while path and path[-1][0] > first.indent:
                popped = path.pop()[0]
                if not path or path[-1][0] < first.indent:
                    first.fail(f"indentation by {first.indent} matches no line above; use {popped}, as the line above")
            if path and path[-1][0] == first.indent:
                path.pop()
            if not path:
                if root is not None:
                    first.fail("a second root starts here; put both under one Sequence or Fallback")
                root = node
            else:
                parent = path[-1][1]
                if not isinstance(parent, _Open):
                    first.fail("the line above takes no children below it; indent this line as far as that one")
                parent.children.append(node)
            path.append((first.indent, node))
        assert root is not None
        return _close(root)

    def line(self) -> Tree | _Open:
        first = self.tokens[self.at]
        node = _Open(self.next(), []) if first.text in CONTROLS and not self.opens_after() else self.node()
        if not self.at_end and self.tokens[self.at].indent is None:
            extra = self.tokens[self.at]
            extra.fail(f"'{extra.text}' follows a complete node; delete it or start a new line")
        return node

    def opens_after(self) -> bool:
        following = self.tokens[self.at + 1 : self.at + 2]
        return bool(following) and following[0].text == "(" and following[0].indent is None

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
        arguments = tuple(self.items(lambda: self.node() if next(wanted, None) == "tree" else self.argument()))
        try:
            return Behavior(name.text, arguments)
        except UserError as error:
            name.fail(str(error))

    def items(self, read: Callable[[], Item]) -> list[Item]:
        """What stands in parentheses, separated by commas; nothing where no parenthesis follows."""
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

    def argument(self) -> str | tuple[float, ...]:
        if not self.peek("("):
            token = self.next()
            if not _NAME.match(token.text):
                token.fail(f"found '{token.text}' where a name should be; write positions as (0, 0, 0.1)")
            return token.text
        opening = self.tokens[self.at]
        numbers = tuple(self.items(self.number))
        if len(numbers) != 3:
            opening.fail(f"a position has three numbers, found {len(numbers)}; write it in metres, as (0, 0, 0.1)")
        return numbers

    def number(self) -> float:
        token = self.next()
        try:
            value = float(token.text) + 0.0
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            token.fail(f"'{token.text}' is not a number; write positions in metres, as (0, 0, 0.1)")
        return value


def _close(node: Tree | _Open) -> Tree:
    if not isinstance(node, _Open):
        return node
    if not node.children:
        node.token.fail(f"{node.token.text} has no children; indent some under it or delete it")
    return Control(CONTROLS[node.token.text], tuple(map(_close, node.children)))


def _unknown(name: _Token) -> NoReturn:
    known = [*CONTROLS, *SIGNATURES]
    close = difflib.get_close_matches(name.text, known, n=1)
    remedy = f"did you mean {close[0]}?" if close else f"use one of {', '.join(known)}"
    name.fail(f"unknown node '{name.text}'; {remedy}")
