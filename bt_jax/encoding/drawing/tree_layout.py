"""Tidy layout of trees: rows by depth, parents centred over their children, subtrees as close as they fit.

After Reingold and Tilford, "Tidier Drawings of Trees" (1981): a subtree is placed by its contour, the leftmost and
rightmost extent of each of its rows. Lengths are pixels, x to the right and y down.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

__all__ = ["Shape", "SubtreeFrame", "TreeLayout", "lay_out"]

GAP = 18.0
ROW_GAP = 46.0
FRAME_PADDING = 12.0


@dataclasses.dataclass(frozen=True)
class Shape:
    """To be placed. `framed` asks for a frame around its subtree, with `caption` of width free at its top left."""

    width: float
    height: float
    children: Sequence[Shape] = ()
    framed: bool = False
    caption: float = 0.0


@dataclasses.dataclass(frozen=True)
class SubtreeFrame:
    """The rectangle around the subtree of a framed node."""

    node: int
    left: float
    top: float
    width: float
    height: float


@dataclasses.dataclass(frozen=True)
class TreeLayout:
    """Where everything is, in prefix order; the drawing starts at (0, 0). `x` is a node's centre, `top` its upper edge,
    `row_bottom` the lower edge of the tallest node of its row: lines below it cross no node. -1 is no parent."""

    x: tuple[float, ...]
    top: tuple[float, ...]
    row_bottom: tuple[float, ...]
    parent: tuple[int, ...]
    frames: tuple[SubtreeFrame, ...]
    width: float
    height: float


@dataclasses.dataclass
class _Placed:
    """A subtree with its root at x = 0: the offset of each child and the extents of its rows."""

    shape: Shape
    children: list[_Placed]
    offsets: list[float]
    contour: list[tuple[float, float]]


def lay_out(root: Shape) -> TreeLayout:
    """Place the nodes of a tree so that none overlap, nor do frames and the nodes outside them."""
    placed = _place(root)
    rows = _row_tops(root)
    x: list[float] = []
    top: list[float] = []
    bottom: list[float] = []
    parents: list[int] = []
    frames: list[SubtreeFrame] = []
    shift = -min(left for left, _ in placed.contour)

    def visit(node: _Placed, center: float, row: int, parent: int) -> None:
        index = len(x)
        x.append(center)
        top.append(rows[row][0])
        bottom.append(rows[row][1])
        parents.append(parent)
        if node.shape.framed:
            left, right = node.contour[0]
            upper = rows[row][0] - 2 * FRAME_PADDING
            lower = rows[row + len(node.contour) - 1][1] + FRAME_PADDING / 2
            frames.append(SubtreeFrame(index, center + left, upper, right - left, lower - upper))
        for child, offset in zip(node.children, node.offsets, strict=True):
            visit(child, center + offset, row + 1, index)

    visit(placed, shift, 0, -1)
    height = max([rows[-1][1], *(frame.top + frame.height for frame in frames)])
    lift = min([0.0, *(frame.top for frame in frames)])
    return TreeLayout(
        tuple(x),
        tuple(value - lift for value in top),
        tuple(value - lift for value in bottom),
        tuple(parents),
        tuple(dataclasses.replace(frame, top=frame.top - lift) for frame in frames),
        shift + max(right for _, right in placed.contour),
        height - lift,
    )


def _place(shape: Shape) -> _Placed:
    nodes = [_place(child) for child in shape.children]
    offsets: list[float] = []
    below: list[tuple[float, float]] = []
    for node in nodes:
        gaps = [right + GAP - left for (_, right), (left, _) in zip(below, node.contour, strict=False)]
        offset = max(gaps, default=0.0)
        offsets.append(offset)
        shifted = [(left + offset, right + offset) for left, right in node.contour]
        merged = [(first[0], second[1]) for first, second in zip(below, shifted, strict=False)]
        below = merged + below[len(merged) :] + shifted[len(merged) :]
    center = (offsets[0] + offsets[-1]) / 2 if offsets else 0.0
    offsets = [offset - center for offset in offsets]
    contour = [(-shape.width / 2, shape.width / 2), *((left - center, right - center) for left, right in below)]
    if shape.framed:
        left = min(*(left for left, _ in contour), FRAME_PADDING - shape.caption) - FRAME_PADDING
        right = max(right for _, right in contour) + FRAME_PADDING
        contour = [(left, right)] * len(contour)
    return _Placed(shape, nodes, offsets, contour)


def _row_tops(root: Shape) -> list[tuple[float, float]]:
    rows: list[tuple[float, float]] = []
    level: list[Shape] = [root]
    y = 0.0
    while level:
        height = max(shape.height for shape in level)
        rows.append((y, y + height))
        y += height + ROW_GAP
        level = [child for shape in level for child in shape.children]
    return rows
