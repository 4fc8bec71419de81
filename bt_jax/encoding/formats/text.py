"""Trees as text that people read and write: one node a line, children indented under their parent.

    Sequence
      move(YellowBox, (0, 0, 0.055), KittingBox)
      Fallback
        gripper(open)
        open_gripper

On one line: `Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), Fallback(gripper(open), open_gripper))`. Both forms
mix: a line may hold a whole subtree in parentheses, and inside parentheses lines may break anywhere. A subtask holds its
tree: `subtask(unstack, Sequence(...))`. The number of a node stands behind its name, `Timeout 5000`, or first in its
parentheses, `Timeout(5000, pick(YellowBox))`. `#` starts a comment.
"""

from __future__ import annotations

import dataclasses

from bt_jax._util.errors import UserError
from bt_jax.behaviors import CONTROLS, EXTENDED, Control, ExtendedNode, Parser, Token, Tree
from bt_jax.behaviors.notation import inner_node
from bt_jax.encoding.formats.depth import TOO_DEEP, check_depth
from bt_jax.encoding.walk import children

__all__ = ["format_tree", "one_line", "parse_tree"]

NAMES = {kind: name for name, kind in CONTROLS.items()}
INDENT = 2


def format_tree(tree: Tree) -> str:
    """Return one node a line, indented by depth, ends with a newline. `parse_tree` reads it back to an equal tree."""
    lines: list[str] = []

    def visit(node: Tree, depth: int) -> None:
        lines.append(" " * (INDENT * depth) + _line(node))
        for child in children(node):
            visit(child, depth + 1)

    visit(tree, 0)
    return "\n".join(lines) + "\n"


def _line(node: Tree) -> str:
    """Return a node without its children."""
    if isinstance(node, Control):
        return NAMES[node.kind]
    if isinstance(node, ExtendedNode):
        return node.name if node.number is None else f"{node.name} {node.number}"
    return str(node)


def one_line(tree: Tree) -> str:
    """Return the tree on one line, children in parentheses. `parse_tree` reads it back to an equal tree."""
    return str(tree)


def parse_tree(text: str) -> Tree:
    """Read what `format_tree` and `one_line` write.

    Raise UserError, with line, column and remedy, if the text is not one tree.
    """
    parser = _Lines(text)
    if parser.at_end:
        raise UserError("the text holds no tree; write at least one node, for instance pick(YellowBox)")
    try:
        return check_depth(parser.tree())
    except RecursionError:
        raise UserError(TOO_DEEP) from None


@dataclasses.dataclass
class _Open:
    """A node whose children are still being read, from the lines below it. Unknown nodes have no number."""

    token: Token
    number: int | None
    children: list[Tree | _Open]


class _Lines(Parser):
    """Adds to the notation the nesting of lines by their indentation."""

    def tree(self) -> Tree:
        """Return the lines, nested by their indentation."""
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
        self.refuse_unknown()
        return _close(root)

    def line(self) -> Tree | _Open:
        first = self.tokens[self.at]
        node: Tree | _Open
        if not self.known() and self.at_name():
            self.skip_unknown()
            node = _Open(first, None, [])
        elif first.text in CONTROLS.keys() | EXTENDED.keys() and not self.opens_after():
            self.next()
            number = self.count() if self.at_number() and self.tokens[self.at].indent is None else None
            node = _Open(first, number, [])
        else:
            node = self.node()
        if not self.at_end and self.tokens[self.at].indent is None:
            extra = self.tokens[self.at]
            extra.fail(f"'{extra.text}' follows a complete node; delete it or start a new line")
        return node

    def opens_after(self) -> bool:
        following = self.tokens[self.at + 1 : self.at + 2]
        return bool(following) and following[0].text == "(" and following[0].indent is None


def _close(node: Tree | _Open) -> Tree:
    if not isinstance(node, _Open):
        return node
    if not node.children:
        node.token.fail(f"{node.token.text} has no children; indent some under it or delete it")
    return inner_node(node.token, list(map(_close, node.children)), node.number)
