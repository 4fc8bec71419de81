from bt_jax.encoding.arrays import Trees, decode, encode, encode_all, length, violations
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text, to_dot
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.formats.text import format_tree, one_line, parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.encoding.interpret import TreeMemory, TreeTick, tick_tree
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.status import Status
from bt_jax.encoding.tick import Counters, JumpTable, Ticked, counters, jump_table, tick_trees
from bt_jax.encoding.walk import children, decorators, depth, leaves, prefix

__all__ = [
    "MAX_NODES",
    "Counters",
    "JumpTable",
    "Status",
    "Ticked",
    "TreeMemory",
    "TreeTick",
    "Trees",
    "children",
    "counters",
    "decode",
    "decorators",
    "depth",
    "draw_text",
    "encode",
    "encode_all",
    "format_tree",
    "from_xml",
    "jump_table",
    "leaves",
    "length",
    "one_line",
    "parse_tree",
    "prefix",
    "read_tree",
    "tick_tree",
    "tick_trees",
    "to_dot",
    "to_py_trees",
    "to_svg",
    "to_xml",
    "violations",
]
