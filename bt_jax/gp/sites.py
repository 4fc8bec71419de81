"""What surrounds a node, as far as the rules of a valid tree look: parent, siblings, and what remains if it goes.

A slot is a place before a node, or the end of a control node's children. Both are described by one `Site`, that of the
node: `before` says what may be inserted in front of it, `behind` what may be appended to its children, `instead` what may
replace it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32

from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.gp.alphabet import Alphabet, LeafSet
from bt_jax.gp.splice import SIZE_BIT

__all__ = ["Site", "describe_sites"]

OTHER = int(Kind.SEQUENCE) + int(Kind.FALLBACK)  # minus a control kind: the other kind


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Site:
    """Nodes of trees with their surroundings. Tokens are 0 where there is no such sibling."""

    node: Int32[Array, "*S"]
    token: Int32[Array, "*S"]
    size: Int32[Array, "*S"]
    length: Int32[Array, "*S"]
    parent: Int32[Array, "*S"]
    control: Int32[Array, "*S"]
    previous: Int32[Array, "*S"]
    next: Int32[Array, "*S"]
    last_child: Int32[Array, "*S"]
    deletable: Bool[Array, "*S"]
    lone: Bool[Array, "*S"]
    merges: Bool[Array, "*S"]

    # `control` is the kind of control node that may stand here (around the whole tree, at the root; a Sequence around a
    # tree of one leaf, since that may be a gene). `lone`: deleting the node leaves its parent with one child, so the parent
    # goes too; `merges`: and so does that child, a control node of the grandparent's kind.

    @property
    def is_root(self) -> Bool[Array, "*S"]:
        return self.node == 0

    @property
    def is_leaf(self) -> Bool[Array, "*S"]:
        return self.token >= FIRST_LEAF

    @property
    def end(self) -> Int32[Array, "*S"]:
        return self.node + self.size

    def before(self, alphabet: Alphabet, *, gene_under_fallback: bool) -> LeafSet:
        """Return leaves that may be inserted before the node."""
        return alphabet.leaves(
            self.previous,
            self.token,
            conditions=~alphabet.is_act(self.previous),
            acts=~alphabet.is_condition(self.token),
            genes=(self.control != Kind.SEQUENCE) | gene_under_fallback,
        )

    def instead(self, alphabet: Alphabet, *, gene_under_fallback: bool) -> LeafSet:
        """Return leaves, other than the node itself, that may replace it."""
        return alphabet.leaves(
            self.previous,
            self.token,
            self.next,
            conditions=~alphabet.is_act(self.previous) & (self.next != 0),
            acts=~alphabet.is_condition(self.next),
            genes=(self.control != Kind.SEQUENCE) | gene_under_fallback,
        )

    def behind(self, alphabet: Alphabet, *, gene_under_fallback: bool) -> LeafSet:
        """Return leaves that may be appended to the node's children."""
        yes = jnp.ones_like(self.node, bool)
        genes = (self.token != Kind.FALLBACK) | gene_under_fallback
        return alphabet.leaves(self.last_child, conditions=~yes, acts=yes, genes=genes)


def describe_sites(
    nodes: Int32[Array, "P N"], at: Int32[Array, "P S"], alphabet: Alphabet, *, gene_under_fallback: bool
) -> Site:
    """Return the surroundings of S nodes in each packed tree."""
    num_nodes = nodes.shape[1]
    sizes = nodes >> SIZE_BIT
    small = jnp.uint8
    ends = jnp.where(sizes > 1, jnp.arange(num_nodes, dtype=jnp.int32)[None] + sizes, 0).astype(small).T
    longest = jnp.max(sizes[:, 0])

    def over_nodes(update: Callable[[Array, Array, Array], Array]) -> Array:
        """Folds the nodes of all trees, one after another, into a value for each slot: (value, node, its end) -> value.
        Nodes run outside, slots inside, so that the loop over trees and slots is a plain vector loop."""

        def step(i: Array, value: Array) -> Array:
            end = jax.lax.dynamic_slice_in_dim(ends, i, 1, axis=0)
            return update(value, i.astype(small), end)

        return jax.lax.fori_loop(0, longest, step, jnp.zeros(at.T.shape, small)).T

    def narrow(index: Array) -> Array:
        return index.astype(small).T

    def get(index: Array) -> tuple[Array, Array]:
        node = jnp.take_along_axis(nodes, jnp.clip(index, 0, num_nodes - 1), axis=1, mode="promise_in_bounds")
        return node & 0xFFFF, node >> SIZE_BIT

    node8 = narrow(at)
    parent = over_nodes(lambda value, i, end: jnp.where((i < node8) & (end > node8), i, value)).astype(jnp.int32)

    token, size = get(at)
    end = at + size
    parent_token, parent_size = get(parent)
    parent_end = parent + parent_size
    eldest_token, eldest_size = get(parent + 1)
    is_first = at == parent + 1
    is_last = end == parent_end
    next_token, next_size = get(end)
    next_token = jnp.where(is_last, 0, next_token)

    # The sibling that stays alone if the node goes.
    lone = jnp.where(is_first, end + next_size == parent_end, (parent + 1 + eldest_size == at) & is_last)
    stays = jnp.where(is_first, end, parent + 1)
    stays_token = jnp.where(is_first, next_token, eldest_token)
    stays_end = stays + jnp.where(is_first, next_size, eldest_size)

    # A leaf just before a position is a sibling there, unless a control node ends at that position; four such questions
    # (and whether the parent is a last child) are answered in one pass.
    parent8, end8, stays8 = narrow(parent), narrow(end), narrow(stays)
    parent_end8, stays_end8 = narrow(parent_end), narrow(stays_end)

    def ask(value: Array, i: Array, end: Array) -> Array:
        answers = (
            (i > parent8) & (end == node8),
            (i > node8) & (end == end8),
            (i < parent8) & (end == parent8),
            (i > stays8) & (end == stays_end8),
            (i < parent8) & (end == parent_end8),
        )
        return value | sum(answer.astype(small) << j for j, answer in enumerate(answers))

    flags = over_nodes(ask)
    before_is_control, last_is_control, uncle_is_control, stays_last_is_control, parent_is_last = (
        (flags >> j) & 1 == 1 for j in range(5)
    )

    def leaf_before(position: Array, is_control: Array) -> Array:
        return jnp.where(is_control, int(Kind.SEQUENCE), get(position - 1)[0])

    previous = jnp.where(is_first, 0, leaf_before(at, before_is_control))
    last_child = leaf_before(end, last_is_control)

    def beside(left: Array, right: Array) -> Array:
        """Return whether two siblings may stand side by side; 0 is the edge of the child list."""
        twice = (left == right) & (left >= FIRST_LEAF)
        ends_in_condition = (right == 0) & alphabet.is_condition(left)
        return ~(twice | ends_in_condition | (alphabet.is_act(left) & alphabet.is_condition(right)))

    stays_is_leaf = stays_token >= FIRST_LEAF
    uncle = leaf_before(parent, uncle_is_control)
    uncle = jnp.where((uncle < FIRST_LEAF) & ~uncle_is_control, 0, uncle)
    aunt = jnp.where(parent_is_last, 0, get(parent_end)[0])
    inner_first = jnp.where(stays_is_leaf, stays_token, get(stays + 1)[0])
    inner_last = jnp.where(stays_is_leaf, stays_token, leaf_before(stays_end, stays_last_is_control))
    joins = beside(uncle, inner_first) & beside(inner_last, aunt)
    if not gene_under_fallback:
        # The survivor moves up, under the grandparent: a Fallback where the parent is a Sequence.
        joins &= ~(alphabet.is_gene(stays_token) & (parent_token == Kind.SEQUENCE))
    at_top = parent == 0
    deletable = jnp.where(lone, jnp.where(at_top, ~stays_is_leaf, joins), beside(previous, next_token))

    return Site(
        node=at,
        token=token,
        size=size,
        length=jnp.broadcast_to(sizes[:, :1], at.shape),
        parent=parent,
        control=jnp.where(parent_token < FIRST_LEAF, OTHER - parent_token, int(Kind.SEQUENCE)),
        previous=previous,
        next=next_token,
        last_child=last_child,
        deletable=deletable & (at > 0),
        lone=lone,
        merges=lone & ~stays_is_leaf & ~at_top,
    )
