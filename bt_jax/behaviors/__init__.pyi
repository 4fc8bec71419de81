from bt_jax.behaviors.names import check_names, is_spot, subgoal_conditions
from bt_jax.behaviors.nodes import (
    EXTENDED,
    Control,
    Decorator,
    ExtendedNode,
    Kind,
    Leaf,
    Node,
    Symbol,
    not_memoryless,
    not_reactive,
)
from bt_jax.behaviors.notation import CONTROLS, Parser, Token, parse_behavior
from bt_jax.behaviors.pool import gene_pool, placing_gene
from bt_jax.behaviors.symbols import CLOSED, NOTHING, OPEN, SIGNATURES, Argument, Behavior, Tree, expand
from bt_jax.behaviors.vocabulary import FIRST_LEAF, Vocabulary

__all__ = [
    "CLOSED",
    "CONTROLS",
    "EXTENDED",
    "FIRST_LEAF",
    "NOTHING",
    "OPEN",
    "SIGNATURES",
    "Argument",
    "Behavior",
    "Control",
    "Decorator",
    "ExtendedNode",
    "Kind",
    "Leaf",
    "Node",
    "Parser",
    "Symbol",
    "Token",
    "Tree",
    "Vocabulary",
    "check_names",
    "expand",
    "gene_pool",
    "is_spot",
    "not_memoryless",
    "not_reactive",
    "parse_behavior",
    "placing_gene",
    "subgoal_conditions",
]
