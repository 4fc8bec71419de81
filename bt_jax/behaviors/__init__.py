"""The symbols that trees are made of, the pool that evolution draws from, and their notation."""

from bt_jax.behaviors.gene_pool import gene_pool
from bt_jax.behaviors.names import check_names, subgoal_conditions
from bt_jax.behaviors.notation import CONTROLS, Parser, Token, parse_behavior
from bt_jax.behaviors.symbols import CLOSED, NOTHING, OPEN, SIGNATURES, Argument, Behavior, Control, Kind, Tree, expand
from bt_jax.behaviors.vocabulary import FIRST_LEAF, Vocabulary

__all__ = [
    "CLOSED",
    "CONTROLS",
    "FIRST_LEAF",
    "NOTHING",
    "OPEN",
    "SIGNATURES",
    "Argument",
    "Behavior",
    "Control",
    "Kind",
    "Parser",
    "Token",
    "Tree",
    "Vocabulary",
    "check_names",
    "expand",
    "gene_pool",
    "parse_behavior",
    "subgoal_conditions",
]
