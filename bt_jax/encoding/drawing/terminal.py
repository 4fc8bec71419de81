"""Trees drawn for the terminal and as Graphviz source; `bt_jax.encoding.drawing.svg` draws pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, L, Node
from bt_jax.behaviors.symbols import Tree, expand
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import children

__all__ = ["draw_text", "symbol", "to_dot"]

SYMBOLS = {Kind.SEQUENCE: "→", Kind.FALLBACK: "?"}
MARKS = {Status.SUCCESS: "✓", Status.FAILURE: "✗", Status.RUNNING: "…", None: " "}
EXTENDED_SYMBOLS = {"ResumingSequence": "→*", "ResumingFallback": "?*"}
DOT_SHAPES = {
    Kind.SEQUENCE: "shape=square",
    Kind.FALLBACK: "shape=square",
    Kind.CONDITION: "shape=ellipse",
    Kind.ACTION: "shape=box style=rounded",
    Kind.GENE: "shape=box style=rounded peripheries=2",
}


def symbol(node: Control[Any] | ExtendedNode[Any]) -> str:
    """Return what stands for a node that has children: → and ?, with * where it remembers the child that was running, or its
    name."""
    return SYMBOLS[node.kind] if isinstance(node, Control) else EXTENDED_SYMBOLS.get(node.name, node.label)


def draw_text(tree: Node[L], statuses: Sequence[Status | None] | None = None) -> str:
    """Return the tree with box-drawing lines, one node a line, → for Sequence and ? for Fallback; ends with a newline.

    `statuses`, one for each node in prefix order, stand at the front: ✓ SUCCESS, ✗ FAILURE, … RUNNING, blank for None.
    """
    lines: list[str] = []

    def visit(node: Node[L], lead: str, rest: str) -> None:
        label = symbol(node) if isinstance(node, Control | ExtendedNode) else node.label
        lines.append(f"{lead}{label}\n")
        below = children(node)
        for child in below[:-1]:
            visit(child, f"{rest}├── ", f"{rest}│   ")
        for child in below[-1:]:
            visit(child, f"{rest}└── ", f"{rest}    ")

    visit(tree, "", "")
    if statuses is None:
        return "".join(lines)
    return "".join(f"{MARKS[status]} {line}" for status, line in zip(statuses, lines, strict=True))


def to_dot(tree: Tree, *, expand_genes: bool = False) -> str:
    """Return Graphviz source; node i in prefix order is called ni and has the SVG id `node-i`."""
    if expand_genes:
        tree = expand(tree)
    lines = ["digraph tree {", "  graph [ordering=out]", '  node [fontname="sans-serif"]', "  edge [arrowhead=none]"]
    count = 0

    def visit(node: Tree) -> int:
        nonlocal count
        index, count = count, count + 1
        label = symbol(node) if isinstance(node, Control | ExtendedNode) else node.label
        shape = "shape=box" if isinstance(node, ExtendedNode) else DOT_SHAPES[node.kind]
        quoted = label.replace("\\", "\\\\").replace('"', '\\"')
        lines.append(f'  n{index} [label="{quoted}" id="node-{index}" {shape}]')
        for child in children(node):
            lines.append(f"  n{index} -> n{visit(child)}")
        return index

    visit(tree)
    return "\n".join([*lines, "}"]) + "\n"
