"""How deep a tree may be: what visits a tree calls itself at every level, and Python allows about 1,000 calls."""

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree, expand
from bt_jax.encoding.walk import depth

__all__ = ["MAX_DEPTH", "TOO_DEEP", "check_depth"]

MAX_DEPTH = 150  # levels, genes written out; trees of evolution have fewer
TOO_DEEP = f"the tree is nested too deeply; make it flatter, of at most {MAX_DEPTH} levels"


def check_depth(tree: Tree) -> Tree:
    """Return the tree. Raise UserError if it is too deep."""
    if depth(expand(tree)) > MAX_DEPTH:
        raise UserError(TOO_DEEP)
    return tree
