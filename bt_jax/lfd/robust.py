"""Plans for a world in which things go wrong."""

from __future__ import annotations

from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind, Tree, expand
from bt_jax.encoding.walk import leaves
from bt_jax.tasks import Task

__all__ = ["patient"]

RETRIES = 10  # failures of a placement, up to which it is tried again


def patient(tree: Tree, task: Task) -> Tree:
    """Return a plan that looks for what each of its placements needs before it goes on, and tries again what fails.

    To look comes first even for an object that is in its place: out of sight it does not count as there, and the gripper
    would let go of what it holds to pick it up.
    """
    parts = tree.children if isinstance(tree, Control) and tree.kind == Kind.SEQUENCE else (tree,)
    found = [_retried(part, task) for part in parts]
    return found[0] if len(found) == 1 else Control.sequence(*found)


def _retried(part: Tree, task: Task) -> Tree:
    """Return a child of a plan's root with a look for every object that it names, and a retry around both."""
    atoms = leaves(expand(part))
    if not any(leaf.name == "place" for leaf in atoms):
        return part
    named = [name for leaf in atoms for name in (leaf.object, leaf.frame) if name in task.instances]
    looks = [Behavior("look", (name,)) for name in dict.fromkeys(named)]
    below = part.children if isinstance(part, Control) and part.kind == Kind.SEQUENCE else (part,)
    return ExtendedNode("retry", (Control.sequence(*looks, *below),), RETRIES)
