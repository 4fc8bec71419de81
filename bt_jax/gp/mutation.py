"""Mutation: add, delete or change a node, always into a valid tree.

The published procedure draws a place, an edit and leaves, and draws all of them again until the tree is valid. Here a few
nodes of each tree are drawn, every edit there is weighed by its published probability times the share of leaf draws that
would have been accepted, and one edit is chosen in proportion: the same distribution, up to the number of nodes drawn.
"""

from __future__ import annotations

import dataclasses
import enum
from itertools import accumulate

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int32, UInt32

from bt_jax.behaviors.nodes import Kind
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import OUTSIDE, Alphabet, LeafSet
from bt_jax.gp.config import MutationConfig
from bt_jax.gp.rng import random_words
from bt_jax.gp.sites import OTHER, Site, describe_sites
from bt_jax.gp.splice import SIZE_BIT, Cut, materialize, pack, splice, unpack

__all__ = ["EditRates", "chain_lengths", "draw_nodes", "mutate", "mutate_chain", "mutate_packed"]

NODES_DRAWN = 4
WORDS = 4 + NODES_DRAWN // 2  # random words a tree and step


class Edit(enum.IntEnum):
    """What can be done at a node. At the root, INSERT and INSERT_CONTROL wrap the tree, as [leaf, tree] and [tree, act],
    and GROW exchanges the kind of control node."""

    DELETE = 0
    INSERT = 1
    INSERT_CONTROL = 2
    REPLACE = 3
    GROW = 4
    APPEND = 5
    APPEND_CONTROL = 6


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class EditRates:
    """What edits are weighed by that depends on the alphabet, rounded to float32 once. An argument of compiled code, which
    therefore does not depend on the task.

    `leaf`: probability of one given leaf among all; `insert` and `replace`: that of adding it, or of replacing a node by it.
    Of all draws under a Sequence and under a Fallback, [2], `leaves` and `acts` (actions and genes) are the share that may
    stand there, and `pairs` the share of pairs [leaf, act] that may be the children of a new control node of that kind.
    """

    leaf: Float32[Array | np.ndarray, ""]
    insert: Float32[Array | np.ndarray, ""]
    replace: Float32[Array | np.ndarray, ""]
    leaves: Float32[Array | np.ndarray, "2"]
    acts: Float32[Array | np.ndarray, "2"]
    pairs: Float32[Array | np.ndarray, "2"]

    @staticmethod
    def of(alphabet: Alphabet, config: MutationConfig) -> EditRates:
        """Return the rates for an alphabet of concrete numbers."""
        leaf, act = 1 / alphabet.num_leaves, 1 / alphabet.num_acts
        holes = (0, 0 if config.gene_under_fallback else alphabet.num_genes)
        pairs = [alphabet.num_pairs(genes=genes) * leaf * act for genes in (True, config.gene_under_fallback)]
        return EditRates(
            leaf=np.array(leaf, np.float32),
            insert=np.array(0.5 * config.add * leaf, np.float32),
            replace=np.array(0.5 * config.change * leaf, np.float32),
            leaves=np.array([(alphabet.num_leaves - n) / alphabet.num_leaves for n in holes], np.float32),
            acts=np.array([(alphabet.num_acts - n) / alphabet.num_acts for n in holes], np.float32),
            pairs=np.array(pairs, np.float32),
        )


def draw_nodes(words: UInt32[Array, "W P"], length: Int32[Array, " P"]) -> Int32[Array, "P S"]:
    """Return uniform nodes of each tree, two from each random word."""
    halves = jnp.concatenate([words & 0xFFFF, words >> 16]).T
    return ((halves * length[:, None].astype(jnp.uint32)) >> 16).astype(jnp.int32)


def mutate(
    key: Array, trees: Trees, alphabet: Alphabet, config: MutationConfig, *, max_nodes: int | None = None
) -> Trees:
    """Return one mutation of each of P valid trees; a tree stays as it is where the nodes drawn admit no edit.

    `max_nodes` bounds the size of the results (default: N).
    """
    return unpack(mutate_packed(key, pack(trees), alphabet, config, max_nodes=max_nodes))


def mutate_chain(key: Array, trees: Trees, alphabet: Alphabet, config: MutationConfig) -> Trees:
    """Return a chain of mutations of each of P trees; see `chain_lengths`."""
    length_key, key = jax.random.split(key)
    nodes = pack(trees)
    steps = chain_lengths(length_key, nodes.shape[0], config)

    def body(step: Array, nodes: Array) -> Array:
        return jnp.where((step < steps)[:, None], mutate_packed(key, nodes, alphabet, config, step=step), nodes)

    return unpack(jax.lax.fori_loop(0, config.max_steps, body, nodes))


def chain_lengths(key: Array, count: int, config: MutationConfig) -> Int32[Array, " P"]:
    """How many mutations make an offspring: 1 to `config.max_steps`, each length `config.chain_ratio` times as likely as
    the one before."""
    weights = np.cumsum(np.array([config.chain_ratio**step for step in range(config.max_steps)]))
    share = (random_words(key, (1, count))[0] >> 8).astype(jnp.float32) * jnp.float32(2**-24 * weights[-1])
    return 1 + sum(
        ((share >= jnp.float32(bound)).astype(jnp.int32) for bound in weights[:-1]), jnp.zeros(count, jnp.int32)
    )


def mutate_packed(
    key: Array,
    nodes: Int32[Array, "P N"],
    alphabet: Alphabet,
    config: MutationConfig,
    *,
    rates: EditRates | None = None,
    max_nodes: int | None = None,
    step: int | Int32[Array, ""] = 0,
) -> Int32[Array, "P N"]:
    """`mutate` for packed trees; steps of one key differ. `rates` must be given where the alphabet is traced."""
    rates = EditRates.of(alphabet, config) if rates is None else rates
    words = random_words(key, (WORDS, nodes.shape[0]), step)
    at = draw_nodes(words[4:], nodes[:, 0] >> SIZE_BIT)
    slots = materialize(describe_sites(nodes, at, alphabet, gene_under_fallback=config.gene_under_fallback))
    weights = _weights(nodes, slots, alphabet, config, rates, max_nodes or nodes.shape[1])
    edits, totals = materialize(_choose(weights, words[0][:, None]))
    drawn, total = _choose([totals[:, i] for i in range(NODES_DRAWN)], words[1])
    slot, edit = jax.tree.map(
        lambda field: jnp.take_along_axis(field, drawn[:, None], axis=1, mode="clip")[:, 0], (slots, edits)
    )
    return _apply(nodes, slot, jnp.where(total > 0, edit, -1), words[2:4], alphabet, config)


def _choose(
    weights: list[Float32[Array, "*S"]], word: UInt32[Array, "*W"]
) -> tuple[Int32[Array, "*S"], Float32[Array, "*S"]]:
    """One index in proportion to the weights, and their sum. An index of weight 0 is never chosen: the sums are taken in
    order, and 23 bits keep a fraction of the total below it."""
    sums = list(accumulate(weights))
    target = (word >> 9).astype(jnp.float32) * jnp.float32(2**-23) * sums[-1]
    return sum((partial <= target).astype(jnp.int32) for partial in sums), sums[-1]


def _weights(
    nodes: Int32[Array, "P N"],
    slot: Site,
    alphabet: Alphabet,
    config: MutationConfig,
    rates: EditRates,
    max_nodes: int,
) -> list[Float32[Array, "P S"]]:
    """Weight of each `Edit` at each slot: its published probability times the share of its draws that are accepted."""
    any_gene = config.gene_under_fallback
    room = max_nodes - slot.length
    leaf, root = slot.is_leaf, slot.is_root
    add, change = 0.5 * config.add, 0.5 * config.change  # a leaf or a control node, evenly
    kind = 0.5  # the wanted kind of control node

    def under(control: Array, shares: Float32[Array | np.ndarray, "2"]) -> Array:
        return jnp.where(control == Kind.FALLBACK, shares[1], shares[0])

    def count(leaves: LeafSet) -> Array:
        return leaves.count().astype(jnp.float32)

    def within(growth: int | Array, weight: Array | np.ndarray) -> Array:
        return jnp.where(room >= growth, weight, 0)

    leaves, acts = under(slot.control, rates.leaves), under(slot.control, rates.acts)
    beside = jnp.where(alphabet.is_act(slot.token), count(_beside(slot, alphabet, config)) * rates.leaf, acts)
    insert = jnp.where(
        root,
        within(2, add * kind * 0.5 * leaves),
        within(1, rates.insert * count(slot.before(alphabet, gene_under_fallback=any_gene))),
    )
    insert_control = jnp.where(
        root, within(2, add * kind * 0.5 * acts), within(3, add * kind * under(slot.control, rates.pairs))
    )
    replace = rates.replace * count(slot.instead(alphabet, gene_under_fallback=any_gene))
    grow = jnp.where(
        root & ~leaf,
        jnp.where(_flippable(nodes, alphabet, any_gene)[:, None], change * kind, 0),
        jnp.where(leaf, within(2, (change + jnp.where(root, add, 0)) * kind * beside), 0),
    )
    append = within(1, rates.insert * count(slot.behind(alphabet, gene_under_fallback=any_gene)))
    append_control = within(3, add * kind * under(OTHER - slot.token, rates.pairs))
    return [
        jnp.where(slot.deletable, jnp.float32(config.delete), 0),
        jnp.where(root & leaf, 0, insert),
        jnp.where(root & leaf, 0, insert_control),
        jnp.where(root, 0, replace),
        grow,
        jnp.where(leaf, 0, append),
        jnp.where(leaf, 0, append_control),
    ]


def _beside(slot: Site, alphabet: Alphabet, config: MutationConfig) -> LeafSet:
    """Return leaves that may stand before an action or gene when a control node takes its place and both become children."""
    sequence = (slot.control != Kind.FALLBACK) | config.gene_under_fallback
    fits = sequence | ~alphabet.is_gene(slot.token)
    return alphabet.leaves(slot.token, conditions=fits, acts=fits, genes=sequence)


def _flippable(nodes: Int32[Array, "P N"], alphabet: Alphabet, gene_under_fallback: bool) -> Bool[Array, " P"]:
    """Whether the root may be of the other kind: no control node below, and no gene where that is against the rules."""
    controls = jnp.sum((nodes >> SIZE_BIT > 1).astype(jnp.int32), axis=1)
    flat = controls == 1
    if gene_under_fallback:
        return flat
    genes = jnp.any(alphabet.is_gene(nodes & 0xFFFF), axis=1)
    return flat & ~(genes & (nodes[:, 0] & 0xFFFF == Kind.SEQUENCE))


def _apply(
    nodes: Int32[Array, "P N"],
    slot: Site,
    edit: Int32[Array, " P"],
    words: UInt32[Array, "2 P"],
    alphabet: Alphabet,
    config: MutationConfig,
) -> Int32[Array, "P N"]:
    """Carry out one edit of each tree; -1 is none. The new nodes are those drawn from the two words."""
    any_gene = config.gene_under_fallback
    root = slot.is_root
    delete, insert, insert_control, replace, grow, append, append_control = (edit == e for e in Edit)
    appends = append | append_control
    new_pair = (insert_control & ~root) | append_control
    wrap_front, wrap_back = insert & root, insert_control & root
    flip = grow & root & ~slot.is_leaf
    grow_act, grow_condition = grow & alphabet.is_act(slot.token), grow & alphabet.is_condition(slot.token)

    def pick(*cases: tuple[Array, int | Array]) -> Array:
        value = jnp.zeros_like(edit)
        for condition, result in cases:
            value = jnp.where(condition, result, value)
        return value

    control = jnp.where(append_control, OTHER - slot.token, slot.control)
    genes = (control != Kind.FALLBACK) | any_gene
    yes = jnp.ones_like(root)
    act = alphabet.leaves(conditions=~yes, acts=yes, genes=genes).draw(words[0])
    single = jax.tree.map(
        lambda before, instead, behind: jnp.where(append, behind, jnp.where(replace, instead, before)),
        *_aligned(
            slot.before(alphabet, gene_under_fallback=any_gene),
            slot.instead(alphabet, gene_under_fallback=any_gene),
            slot.behind(alphabet, gene_under_fallback=any_gene),
        ),
    ).draw(words[1])
    partner = jnp.where(new_pair, act, jnp.where(grow_act, slot.token, 0))
    front = alphabet.leaves(partner, conditions=yes, acts=yes, genes=genes).draw(words[1])

    one = 1 << SIZE_BIT
    control_size = pick((yes, 3), (wrap_front | wrap_back, slot.length + 2), (flip, slot.length))
    starts_with_control = new_pair | wrap_front | wrap_back | grow
    donor = jnp.stack(
        [
            jnp.where(starts_with_control, control | (control_size << SIZE_BIT), single | one),
            front | one,
            act | one,
        ],
        axis=1,
    )

    leaves_lone = delete & slot.lone
    is_first = slot.node == slot.parent + 1
    merged = slot.merges.astype(jnp.int32)
    first = Cut(
        at=pick((leaves_lone, slot.parent), (~leaves_lone, slot.node), (appends, slot.end)),
        removed=pick(
            (delete | replace, slot.size),
            (leaves_lone, 1 + merged + jnp.where(is_first, slot.size, 0)),
            (flip, 1),
        ),
        inserted=pick((insert | replace | append | wrap_back | grow, 1), (wrap_front | grow_act, 2), (new_pair, 3)),
        start=jnp.zeros_like(edit),
    )
    second = Cut(
        at=pick((leaves_lone, slot.node), (wrap_back | grow_condition, slot.end)),
        removed=pick((leaves_lone & ~is_first, slot.size)),
        inserted=pick((wrap_back | grow_condition, 1)),
        start=jnp.full_like(edit, 2),
    )
    growth = first.inserted - first.removed + second.inserted - second.removed
    return splice(
        nodes,
        donor,
        first,
        second,
        anchor=jnp.where(appends, slot.node, slot.parent),
        growth=jnp.where(root & ~appends, 0, growth),
    )


def _aligned(*sets: LeafSet) -> list[LeafSet]:
    """Return the sets with equally many holes, so that one can be selected element by element."""
    most = max(len(leaves.holes) for leaves in sets)
    return [LeafSet(s.low, s.high, s.holes + (jnp.full_like(s.low, OUTSIDE),) * (most - len(s.holes))) for s in sets]
