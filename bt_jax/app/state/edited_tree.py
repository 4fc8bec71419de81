"""A tree that a person edits: immutable, every change gives another one.

A node may be switched off, with all that is below it; it is kept, and does not run. What is locked is one gene,
`subtask(name, ...)`, as everywhere in this package: it runs as before, and evolution never takes it apart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Literal

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind, Tree
from bt_jax.encoding.walk import children, prefix

__all__ = [
    "Direction",
    "Edited",
    "Head",
    "Part",
    "Path",
    "Where",
    "at",
    "delete",
    "insert",
    "lock",
    "move",
    "nudge",
    "paths",
    "switch",
    "wrap",
]

Head = Behavior | Kind | tuple[str, int | None]  # a leaf, a Sequence or Fallback, or name and number of another node
Path = tuple[int, ...]  # which child of the root, which child of that, and so on
Where = Literal["before", "after", "inside"]
Direction = Literal["earlier", "later", "out", "in"]
MOST = 200  # nodes, switched off or not
LOCKED = "locked_part"


@dataclasses.dataclass(frozen=True)
class Part:
    """A node of an edited tree with what is below it."""

    head: Head
    children: tuple[Part, ...] = ()
    off: bool = False

    @staticmethod
    def of(tree: Tree) -> Part:
        """Return a tree as one that can be edited, all of it switched on."""
        head: Head = tree if isinstance(tree, Behavior) else tree.kind if isinstance(tree, Control) else _head(tree)
        return Part(head, tuple(map(Part.of, children(tree))))

    @property
    def tree(self) -> Tree:
        """All of it, switched off or not."""
        below = tuple(child.tree for child in self.children)
        if isinstance(self.head, Behavior):
            return self.head
        if isinstance(self.head, Kind):
            return Control(self.head, below)
        return ExtendedNode(self.head[0], below, self.head[1])

    @property
    def working(self) -> Part | None:
        """What is switched on, without nodes that have nothing left to do; None if nothing is left."""
        below = tuple(one for child in self.children if (one := child.working) is not None)
        if self.off or (self.children and not below):
            return None
        return dataclasses.replace(self, children=below)

    @property
    def size(self) -> int:
        """The number of nodes."""
        return 1 + sum(child.size for child in self.children)

    @property
    def works_at(self) -> list[int]:
        """For each node of `working`, in prefix order, its number in prefix order here."""
        return [number for number, path in enumerate(paths(self)) if self._works(path)]

    @property
    def off_at(self) -> list[int]:
        """The numbers, in prefix order, of the nodes that do not run."""
        works = set(self.works_at)
        return [number for number in range(self.size) if number not in works]

    @property
    def unused(self) -> tuple[Behavior, ...]:
        """The leaves that stand only where the tree is switched off."""
        used = set() if self.working is None else _leaves(self.working)
        return tuple(leaf for leaf in dict.fromkeys(_in_order(self)) if leaf not in used)

    def _works(self, path: Path) -> bool:
        parts = [at(self, path[:depth]) for depth in range(len(path) + 1)]
        return not any(part.off for part in parts) and parts[-1].working is not None


@dataclasses.dataclass(frozen=True)
class Edited:
    """A tree after a change, and the node that the change was about."""

    part: Part
    path: Path

    def __post_init__(self) -> None:
        if self.part.working is None:
            raise UserError("then nothing would be left to do; add something else first, or undo")
        if self.part.size > MOST:
            raise UserError(f"a tree that is edited here has at most {MOST} nodes; delete some first")


def paths(part: Part) -> list[Path]:
    """Return where the nodes are, in prefix order."""
    below = [(i, *path) for i, child in enumerate(part.children) for path in paths(child)]
    return [(), *below]


def at(part: Part, path: Path) -> Part:
    """Return the node at a path."""
    return at(part.children[path[0]], path[1:]) if path else part


def insert(part: Part, path: Path, new: Part, where: Where) -> Edited:
    """Put something beside a node, or inside it as the last that it does; what holds one child or none is put into a
    Sequence together with it."""
    there = at(part, path)
    if where == "inside" and isinstance(there.head, Kind):
        inside = dataclasses.replace(there, children=(*there.children, new))
        return Edited(_replaced(part, path, inside), (*path, len(there.children)))
    if where == "inside" and there.children:
        return insert(part, (*path, 0), new, "inside")
    first = where == "before"
    if not path or not isinstance(at(part, path[:-1]).head, Kind):
        both = Part(Kind.SEQUENCE, (new, there) if first else (there, new))
        return Edited(_replaced(part, path, both), (*path, 0 if first else 1))
    *way, index = path
    place = index + (not first)
    parent = at(part, tuple(way))
    beside = (*parent.children[:place], new, *parent.children[place:])
    return Edited(_replaced(part, tuple(way), dataclasses.replace(parent, children=beside)), (*way, place))


def delete(part: Part, path: Path) -> Edited:
    """Take a node away with what is below it, and whatever has nothing left to do then."""
    if not path:
        raise UserError("the whole tree cannot be deleted; delete what is in it, or choose another tree")
    *way, index = path
    parent = at(part, tuple(way))
    left = parent.children[:index] + parent.children[index + 1 :]
    if not left:
        return delete(part, tuple(way))
    found = _replaced(part, tuple(way), dataclasses.replace(parent, children=left))
    return Edited(found, (*way, min(index, len(left) - 1)))


def wrap(part: Part, path: Path, head: Kind | tuple[str, int | None]) -> Edited:
    """Put a node around another."""
    return Edited(_replaced(part, path, Part(head, (at(part, path),))), path)


def move(part: Part, path: Path, to: Path, where: Where) -> Edited:
    """Take a node from its place, and put it beside or inside another."""
    if to[: len(path)] == path:
        raise UserError("a part cannot be moved into itself; drop it somewhere else")
    hole, goal = Part(Kind.PAD), Part(Kind.PAD)  # stand for the old place and the new one
    taken = at(part, path)
    there = insert(_replaced(part, path, hole), to, goal, where).part
    without = delete(there, _find(there, hole)).part
    place = _find(without, goal)
    return Edited(_replaced(without, place, taken), place)


def nudge(part: Part, path: Path, direction: Direction) -> Edited:
    """Move a node by one place: before the one before it, behind the next, out of its parent, or into the one before it."""
    if not path:
        raise UserError("this is the whole tree; choose a part of it to move")
    *way, index = path
    siblings = at(part, tuple(way)).children
    if direction == "earlier" and index > 0:
        return move(part, path, (*way, index - 1), "before")
    if direction == "later" and index < len(siblings) - 1:
        return move(part, path, (*way, index + 1), "after")
    if direction == "out" and way:
        return move(part, path, tuple(way), "after")
    if direction == "in" and index > 0 and siblings[index - 1].children:
        return move(part, path, (*way, index - 1), "inside")
    raise UserError("it cannot be moved any further in this direction")


def switch(part: Part, path: Path) -> Edited:
    """Switch a node off with all that is below it, or on again."""
    there = at(part, path)
    return Edited(_replaced(part, path, dataclasses.replace(there, off=not there.off)), path)


def lock(part: Part, path: Path) -> Edited:
    """Make one gene of a node with all that is below it, or take such a gene apart again."""
    there = at(part, path)
    if isinstance(there.head, Behavior):
        body = there.head.body
        if body is None:
            raise UserError("a single action or question is never taken apart; lock what holds several")
        return Edited(_replaced(part, path, dataclasses.replace(Part.of(body), off=there.off)), path)
    if any(at(there, below).off for below in paths(there)[1:]):
        raise UserError("a part of it is switched off; switch that on or delete it, then lock")
    taken = {node.head.args[0] for node in _nodes(part) if isinstance(node.head, Behavior) and node.head.args}
    name = next(name for i in range(1, MOST + 2) if (name := f"{LOCKED}_{i}") not in taken)
    gene = Part(Behavior("subtask", (name, there.tree)), off=there.off)
    return Edited(_replaced(part, path, gene), path)


def _head(node: ExtendedNode[Behavior]) -> tuple[str, int | None]:
    return node.name, node.number


def _replaced(part: Part, path: Path, new: Part) -> Part:
    if not path:
        return new
    below = list(part.children)
    below[path[0]] = _replaced(below[path[0]], path[1:], new)
    return dataclasses.replace(part, children=tuple(below))


def _find(part: Part, wanted: Part) -> Path:
    return next(path for path in paths(part) if at(part, path) is wanted)


def _nodes(part: Part) -> Iterator[Part]:
    yield part
    for child in part.children:
        yield from _nodes(child)


def _in_order(part: Part) -> list[Behavior]:
    return [node.head for node in _nodes(part) if isinstance(node.head, Behavior)]


def _leaves(part: Part) -> set[Behavior]:
    """Return the leaves, and those inside of what is locked."""
    found = set(_in_order(part))
    bodies = [leaf.body for leaf in found if leaf.body is not None]
    return found | {node for body in bodies for node in prefix(body) if isinstance(node, Behavior)}
