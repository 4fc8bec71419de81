"""A tree as a nested list, for people who do not see its drawing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from html import escape

from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.walk import children

__all__ = ["STATUS_WORDS", "tree_list"]

STATUS_WORDS = {"success": "done", "running": "at work", "failure": "failed", "idle": "not asked"}


def tree_list(tree: Tree, say: Callable[[Tree], str], classes: Mapping[str, str], folded: Collection[str]) -> str:
    """Return the list as HTML. `say` puts a node into words, `classes` are the status classes of nodes by their ids
    (`encoding.drawing.svg`), empty if it has not run; nothing below the nodes `folded` is listed."""
    count = 0

    def item(node: Tree, name: str, inside: Callable[[Tree], str]) -> str:
        status = f": {STATUS_WORDS[classes[name]]}" if name in classes else ""
        below = inside(node)
        shown = f"<ul>{below}</ul>" if below and name not in folded else ""
        return f"<li>{escape(say(node))}{status}{shown}</li>"

    def gene(subtree: Tree, name: str) -> str:
        number = 0

        def visit(node: Tree) -> str:
            nonlocal number
            number += 1
            return item(node, f"{name}-{number}", lambda node: "".join(map(visit, children(node))))

        return "".join(map(visit, children(subtree)))

    def visit(node: Tree) -> str:
        nonlocal count
        name, count = f"node-{count}", count + 1
        if isinstance(node, Behavior) and node.subtree is not None:
            subtree = node.subtree
            return item(node, name, lambda node: gene(subtree, name))
        return item(node, name, lambda node: "".join(map(visit, children(node))))

    return f"<ul>{visit(tree)}</ul>"
