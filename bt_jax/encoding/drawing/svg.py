"""Trees as pictures in the style of the Behavior Tree literature, made without Graphviz.

Control nodes are squares with → and ?, other nodes with children boxes with their name, conditions ellipses, actions rounded
boxes, genes boxes with a double edge. The
group of node i (prefix order) has the id `node-i` and one class for its status: success, failure, running or idle. To
colour a live tree, change only that class. The colours are those of Okabe and Ito, which the colour-blind tell apart;
besides, running is dashed and failure has a thick edge.

For people who do not program, nodes carry words instead of symbols, and subtrees fold: then the group of a node that can
be folded or unfolded has the class `foldable`, and the number of nodes that it hides stands at its corner.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import textwrap
import unicodedata
from collections.abc import Callable, Collection, Sequence
from html import escape
from typing import Any

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, L, Node
from bt_jax.behaviors.symbols import Behavior, Tree
from bt_jax.encoding.drawing.terminal import symbol
from bt_jax.encoding.drawing.tree_layout import Shape, SubtreeFrame, TreeLayout, lay_out
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import children, prefix

__all__ = ["STYLE", "node_ids", "status_class", "to_svg"]

FONT_SIZE = 13.0
LINE_HEIGHT = 17.0
SYMBOL_SIZE = 40.0
LINE_LENGTH = 20
MARGIN = 16.0
TITLE_HEIGHT = 34.0

# A space after a comma, but not one inside a position, whose parenthesis is followed by something.
_ARGUMENT_END = re.compile(r"(?<=,) (?![^()]*\).)")

STYLE = """
.bt { font: 13px "Helvetica Neue", Helvetica, Arial, "Liberation Sans", "DejaVu Sans", sans-serif; }
.bt text { text-anchor: middle; fill: #1d2733; }
.bt .background { fill: #ffffff; }
.bt .title { font-size: 17px; font-weight: bold; text-anchor: start; }
.bt .edge { fill: none; stroke: #8a94a0; stroke-width: 1.5; }
.bt .frame { fill: #f3f5f8; stroke: #8a94a0; stroke-width: 1; }
.bt .caption { font-size: 12px; text-anchor: start; fill: #56616d; }
.bt .symbol { font-size: 22px; font-weight: bold; }
.bt .shape { fill: #ffffff; stroke: #3b4754; stroke-width: 1.5; }
.bt .condition .shape { fill: #fbf7ea; }
.bt .foldable { cursor: pointer; }
.bt .foldable:focus-visible .shape { stroke: #e69f00; stroke-width: 4; }
.bt .badge { fill: #3b4754; }
.bt .hidden-count { fill: #ffffff; font-size: 11px; font-weight: bold; }
.bt .inner { fill: none; stroke: #3b4754; stroke-width: 1; }
.bt .success .shape { fill: #bfe6d8; stroke: #009e73; }
.bt .failure .shape { fill: #f6c8a8; stroke: #d55e00; stroke-width: 3.5; }
.bt .running .shape { fill: #cbe6f7; stroke: #0072b2; stroke-width: 2.5; stroke-dasharray: 7 4; }
"""


def status_class(status: Status | None) -> str:
    """Return the CSS class of a status: `success`, `failure`, `running`, or `idle` for a node that was not ticked."""
    return "idle" if status is None else status.name.lower()


def to_svg(
    tree: Node[L],
    statuses: Sequence[Status | None] | None = None,
    *,
    title: str = "",
    expand_genes: bool = False,
    words: Callable[[Node[L]], str] | None = None,
    folded: Collection[str] | None = None,
) -> str:
    """Return the tree as one SVG element with its own style, to be written to a file or put into a page.

    `statuses` has one entry for each node in prefix order, None where it was not ticked. `expand_genes` draws the
    subtree of each gene in a frame; numbers stay those of the tree as given: the root of the subtree has the id
    `node-i` and the status of the gene, and the nodes under it are `node-i-1`, `node-i-2`, ... (`node_ids`). `words` says
    what stands in a node; its symbol is then what a pointer over it shows. `folded` are the ids of nodes, genes among
    them, of which nothing below is drawn; all other genes are expanded.
    """
    nodes = _nodes(tree, expand_genes, words, folded)
    layout = lay_out(_shape(nodes))
    top = MARGIN + (TITLE_HEIGHT if title else 0.0)
    width = max(layout.width, _text_width(title) * 17 / FONT_SIZE) + 2 * MARGIN
    height = top + layout.height + MARGIN
    flat = _prefix(nodes)
    known: dict[int | None, Status | None] = {}
    if statuses is not None:
        known.update(zip(range(len(prefix(tree))), statuses, strict=True))
    role = "img" if folded is None else "group"  # in a picture, nothing could be reached by keyboard or screen reader
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="bt" role="{role}" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}">',
        f"<title>{escape(title or 'Behavior Tree')}</title>",
        f"<style>{STYLE}</style>",
        f'<rect class="background" width="{width:.0f}" height="{height:.0f}"/>',
    ]
    if title:
        parts.append(f'<text class="title" x="{MARGIN:g}" y="{MARGIN + 14:g}">{escape(title)}</text>')
    parts.append(f'<g transform="translate({(width - layout.width) / 2:g} {top:g})">')
    parts += [_frame(frame, flat[frame.node]) for frame in layout.frames]
    parts += [_edge(layout, flat, i) for i in range(1, len(flat))]
    parts += [_node(node, layout.x[i], layout.top[i], known.get(node.index)) for i, node in enumerate(flat)]
    return "\n".join([*parts, "</g>", "</svg>"]) + "\n"


def node_ids(tree: Node[L]) -> list[str]:
    """Return the ids of the nodes of `expand(tree)` in prefix order, where `to_svg(tree)` draws them."""
    ids: list[str] = []
    for i, node in enumerate(prefix(tree)):
        gene = node.subtree if isinstance(node, Behavior) else None
        ids += [f"node-{i}", *(f"node-{i}-{j}" for j in range(1, 1 if gene is None else len(prefix(gene))))]
    return ids


@dataclasses.dataclass(frozen=True)
class _Node:
    """A node to be drawn; `index` is its number, or None inside a gene; `gene` is the gene whose root it is; `hides` is
    the number of nodes below that are not drawn, `folds` whether a person may change that."""

    tree: Node[Any]
    id: str
    index: int | None
    children: tuple[_Node, ...]
    gene: Behavior | None = None
    words: Callable[[Any], str] | None = None
    hides: int = 0
    folds: bool = False

    @property
    def lines(self) -> list[str]:
        if self.words is not None:
            mark = f"{symbol(self.tree)} " if isinstance(self.tree, Control) else ""
            return _wrapped(mark + self.words(self.tree))
        if isinstance(self.tree, ExtendedNode):
            return [symbol(self.tree)]
        return [] if isinstance(self.tree, Control) else _broken(self.tree.label)

    @property
    def kind(self) -> Kind | None:
        """Its kind, None for nodes with children that are neither Sequence nor Fallback."""
        return None if isinstance(self.tree, ExtendedNode) else self.tree.kind

    @property
    def size(self) -> tuple[float, float]:
        if not self.lines:
            return SYMBOL_SIZE, SYMBOL_SIZE
        wide, high = max(map(_text_width, self.lines)), LINE_HEIGHT * len(self.lines)
        # An ellipse is wider than the text in it, by less than the square root of two since text has no full corners.
        return (1.3 * wide + 16, 1.3 * high + 14) if self.kind == Kind.CONDITION else (wide + 24, high + 18)


def _nodes(
    tree: Node[L], expand_genes: bool, words: Callable[[Node[L]], str] | None, folded: Collection[str] | None
) -> _Node:
    count = 0

    def visit(node: Node[L]) -> _Node:
        nonlocal count
        index, count = count, count + 1
        found = _Node(node, f"node-{index}", index, tuple(map(visit, children(node))), words=words)
        if not isinstance(node, Behavior) or node.subtree is None:
            return _folded(found, folded, 0)
        if expand_genes if folded is None else found.id not in folded:
            return _gene(node, node.subtree, index, words, folded)
        return _folded(found, folded, len(prefix(node.subtree)) - 1)

    return visit(tree)


def _gene(
    gene: Behavior,
    subtree: Tree,
    index: int,
    words: Callable[[Any], str] | None,
    folded: Collection[str] | None,
) -> _Node:
    count = 0

    def visit(node: Tree) -> _Node:
        nonlocal count
        name, count = f"node-{index}-{count}" if count else f"node-{index}", count + 1
        found = _Node(node, name, None, tuple(map(visit, children(node))), words=words)
        return found if name == f"node-{index}" else _folded(found, folded, 0)

    return dataclasses.replace(visit(subtree), index=index, gene=gene, folds=folded is not None)


def _folded(node: _Node, folded: Collection[str] | None, inside: int) -> _Node:
    """Without what is below it where it is folded; `inside` is what a gene hides."""
    if folded is None or not (node.children or inside):
        return node
    if node.id not in folded:
        return dataclasses.replace(node, folds=True)
    return dataclasses.replace(node, children=(), hides=inside or len(_prefix(node)) - 1, folds=True)


def _prefix(node: _Node) -> list[_Node]:
    return [node, *(below for child in node.children for below in _prefix(child))]


def _shape(node: _Node) -> Shape:
    width, height = node.size
    below = tuple(map(_shape, node.children))
    if node.gene is None:
        return Shape(width, height, below)
    return Shape(width, height, below, framed=True, caption=_text_width(_caption(node)) + 16)


def _caption(node: _Node) -> str:
    assert node.gene is not None
    if node.words is not None:
        return node.words(node.gene)
    return node.gene.label if node.gene.name == "subtask" else node.gene.name


def _wrapped(text: str) -> list[str]:
    """Return words in as few lines as they need, all about as long."""
    wrap = functools.partial(textwrap.wrap, text, break_long_words=False)
    count = len(wrap(LINE_LENGTH))
    return next(lines for width in range(1, LINE_LENGTH + 1) if len(lines := wrap(width)) <= count)


def _text_width(text: str) -> float:
    """Width in pixels that the text needs at most in common sans-serif fonts."""
    return FONT_SIZE * sum(1.05 if c in "MW@m%" or unicodedata.east_asian_width(c) in "WF" else 0.62 for c in text)


def _broken(label: str) -> list[str]:
    """Return a label in lines, broken after its arguments; positions stay whole."""
    lines: list[str] = []
    for piece in _ARGUMENT_END.split(label):
        if lines and len(lines[-1]) + len(piece) < LINE_LENGTH:
            lines[-1] += f" {piece}"
        else:
            lines.append(piece)
    return lines


def _frame(frame: SubtreeFrame, node: _Node) -> str:
    assert node.gene is not None
    where = f'x="{frame.left:g}" y="{frame.top:g}" width="{frame.width:g}" height="{frame.height:g}"'
    caption = f'<text class="caption" x="{frame.left + 8:g}" y="{frame.top + 16:g}">{escape(_caption(node))}</text>'
    return f'<g><title>{escape(str(node.gene))}</title><rect class="frame" {where} rx="10"/>{caption}</g>'


def _edge(layout: TreeLayout, nodes: list[_Node], i: int) -> str:
    """From the parent down to the gap between the rows, across, and down to the child."""
    parent = layout.parent[i]
    x0, y0 = layout.x[parent], layout.top[parent] + nodes[parent].size[1]
    x1, y1 = layout.x[i], layout.top[i]
    middle = (layout.row_bottom[parent] + 12) if abs(x1 - x0) > 1 else y0
    radius = min(8.0, abs(x1 - x0) / 2)
    side = radius if x1 > x0 else -radius
    bend = (
        f"V{middle - radius:g}Q{x0:g} {middle:g} {x0 + side:g} {middle:g}"
        f"H{x1 - side:g}Q{x1:g} {middle:g} {x1:g} {middle + radius:g}"
    )
    return f'<path class="edge" d="M{x0:g} {y0:g}{bend if abs(x1 - x0) > 1 else ""}V{y1:g}"/>'


def _node(node: _Node, x: float, top: float, status: Status | None) -> str:
    width, height = node.size
    middle = top + height / 2
    kind, has_children = node.kind, isinstance(node.tree, Control | ExtendedNode)
    if kind == Kind.CONDITION:
        ellipse = f'cx="{x:g}" cy="{middle:g}" rx="{width / 2:g}" ry="{height / 2:g}"'
        shapes = f'<ellipse class="shape" {ellipse}/>'
    else:
        shapes = _box("shape", x, top, width, height, 3.0 if has_children else 9.0)
    if kind == Kind.GENE:
        shapes += _box("inner", x, top + 4, width - 8, height - 8, 6.0)
    if not node.lines:
        label = f'<text class="symbol" x="{x:g}" y="{middle + 8:g}">{symbol(node.tree)}</text>'
    else:
        first = middle - LINE_HEIGHT * (len(node.lines) - 1) / 2 + 4.5
        label = "".join(
            f'<text x="{x:g}" y="{first + LINE_HEIGHT * i:g}">{escape(line)}</text>'
            for i, line in enumerate(node.lines)
        )
    if node.hides:
        label += _badge(node.hides, x + width / 2, top + height)
    name = _name(node.tree)
    tip = f"{node.words(node.tree)}\n{name}" if node.words is not None else name
    which = "extended" if kind is None else kind.name.lower()
    classes = f"node {which} {status_class(status)}{' foldable' if node.folds else ''}"
    role = f' tabindex="0" role="button" aria-expanded="{"false" if node.hides else "true"}"' if node.folds else ""
    return f'<g id="{node.id}" class="{classes}"{role}><title>{escape(tip)}</title>{shapes}{label}</g>'


def _name(tree: Node[Any]) -> str:
    """Return what a pointer over a node shows."""
    if isinstance(tree, Control):
        return tree.kind.name.title()
    return tree.label if isinstance(tree, ExtendedNode) else str(tree)


def _badge(count: int, x: float, y: float) -> str:
    """How many nodes are hidden, at the corner of their node."""
    text = f"+{count}"
    width = _text_width(text) + 8
    where = f'x="{x - width + 6:g}" y="{y - 9:g}" width="{width:g}" height="16"'
    rect = f'<rect class="badge" {where} rx="8"/>'
    return f'{rect}<text class="hidden-count" x="{x - width / 2 + 6:g}" y="{y + 3:g}">{text}</text>'


def _box(name: str, x: float, top: float, width: float, height: float, radius: float) -> str:
    where = f'x="{x - width / 2:g}" y="{top:g}" width="{width:g}" height="{height:g}"'
    return f'<rect class="{name}" {where} rx="{radius:g}"/>'
