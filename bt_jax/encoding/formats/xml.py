"""Trees as BehaviorTree.CPP XML, format 4, which Groot2 opens and BehaviorTree.CPP executes: the tags, and writing.

Memoryless control nodes are ReactiveSequence and ReactiveFallback there; other nodes have the tags of `EXTENDED`. Leaves
are compact tags with ports, `<Pick object="YellowBox"/>`; positions are written "x;y;z", as BehaviorTree.CPP writes
vectors. A gene is a `<SubTree ID="Move" .../>` with one `<BehaviorTree ID="Move">` whose leaves read the ports as
`{object}`; a subtask is a `<SubTree ID="Subtask_NAME"/>`.

`retry` and `timeout` count over ticks, as no decorator of BehaviorTree.CPP does: its RetryUntilSuccessful tries again
within one tick, and its Timeout reads a clock. They are `<RetryOverTicks>` and `<TimeoutInTicks>`, which a program has to
register as it does the leaves; `docs/concepts/encoding.md` has the code.

In a memoryless tree the children of a node take turns at RUNNING, at which BehaviorTree.CPP throws if a program has called
`BT::ReactiveSequence::EnableException(true)`; see `docs/concepts/encoding.md`.

Format: https://www.behaviortree.dev/docs/learn-the-basics/xml_format
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import EXTENDED, SIGNATURES, Argument, Behavior, Control, ExtendedNode, Kind, Tree, expand
from bt_jax.encoding.walk import leaves

__all__ = ["CONTROLS", "EXPLICIT", "EXTENDED_NAMES", "LEAVES", "SUBTASK", "to_xml"]

CONTROLS = {"ReactiveSequence": Kind.SEQUENCE, "ReactiveFallback": Kind.FALLBACK}
CONTROL_TAGS = {kind: tag for tag, kind in CONTROLS.items()}
EXTENDED_NAMES = {kind.tag: name for name, kind in EXTENDED.items()}
SUBTASK = "Subtask_"
LEAF_TAGS = {name: "".join(word.title() for word in name.split("_")) for name in SIGNATURES if name != "subtask"}
TURNED = "Turned"  # behind the tag of a gene that says how the object should be turned
TURNED_TAGS = {name: f"{tag}{TURNED}" for name, tag in LEAF_TAGS.items() if SIGNATURES[name].kind == Kind.GENE}
LEAVES = {tag: name for tags in (LEAF_TAGS, TURNED_TAGS) for name, tag in tags.items()}
EXPLICIT = ("Action", "Condition", "Control", "Decorator", "SubTree")
MODEL_TAGS = {Kind.CONDITION: "Condition", Kind.ACTION: "Action", Kind.GENE: "SubTree"}


def to_xml(tree: Tree, *, name: str = "MainTree", expand_genes: bool = False) -> str:
    """Return the tree as an XML document whose main tree is called `name`; `from_xml` reads it back to an equal tree.

    `expand_genes` writes the subtree of each gene in its place instead of a SubTree; that is then what is read back.
    Raise UserError if `name` cannot be a tree's name.
    """
    taken = {*CONTROLS, *EXTENDED_NAMES, *LEAVES, *EXPLICIT}
    if not re.fullmatch(r"[A-Za-z][\w-]*", name) or name in taken:
        raise UserError(f"'{name}' cannot name a tree in XML; use letters, digits, - and _, and not the name of a node")
    root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": name})
    tree = expand(tree) if expand_genes else tree
    _write(SubElement(root, "BehaviorTree", {"ID": name}), tree)
    subtasks, genes = _genes(tree)
    for subtask, body in subtasks.items():
        _write(SubElement(root, "BehaviorTree", {"ID": f"{SUBTASK}{subtask}"}), body)
    for gene in sorted(genes):
        _write_gene(root, gene)
    turned = any("turn" in element.attrib for element in root.iter())
    _write_models(root, subtasks, turned=turned)
    _write_decorators(root)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _genes(tree: Tree) -> tuple[dict[str, Tree], set[str]]:
    """The subtasks in a tree, by name, and the tags of the other genes, also those inside of subtasks. Raise UserError
    if two different subtasks have one name."""
    subtasks: dict[str, Tree] = {}
    genes: set[str] = set()
    open_ = [tree]
    while open_:
        for node in leaves(open_.pop()):
            if node.kind != Kind.GENE:
                continue
            if node.body is None:
                genes.add(_tag(node))
            elif node.label not in subtasks:
                subtasks[node.label] = node.body
                open_.append(node.body)
            elif subtasks[node.label] != node.body:
                raise UserError(f"two different subtasks are called '{node.label}'; rename one of them")
    return subtasks, genes


def _write(parent: Element, node: Tree) -> None:
    if isinstance(node, Control | ExtendedNode):
        element = SubElement(parent, CONTROL_TAGS[node.kind]) if isinstance(node, Control) else _extended(parent, node)
        for child in node.children:
            _write(element, child)
        return
    if node.name == "subtask":
        SubElement(parent, "SubTree", {"ID": f"{SUBTASK}{node.label}"})
        return
    signature = SIGNATURES[node.name]
    ports = dict(zip(signature.arguments + signature.optional, map(_port_text, node.args), strict=False))
    if node.kind == Kind.GENE:
        SubElement(parent, "SubTree", {"ID": _tag(node), **ports})
    else:
        SubElement(parent, _tag(node), ports)


def _tag(leaf: Behavior) -> str:
    """Return the tag of a leaf. A gene with a turn has its own, since each definition of a SubTree has its ports."""
    return (TURNED_TAGS if leaf.kind == Kind.GENE and leaf.turn is not None else LEAF_TAGS)[leaf.name]


def _extended(parent: Element, node: ExtendedNode[Behavior]) -> Element:
    port = node.meaning.port
    return SubElement(parent, node.meaning.tag, {} if port is None else {port: str(node.number)})


def _write_gene(root: Element, tag: str) -> None:
    """Write the subtree of a gene with ports in place of its arguments: expanded with the values below as stand-ins,
    which no other leaf of the subtree has."""
    name = LEAVES[tag]
    numbers: dict[str, Argument] = {"position": (0.0, 0.0, 0.0), "turn": 0.0}
    arguments = SIGNATURES[name].arguments + (SIGNATURES[name].optional if tag in TURNED_TAGS.values() else ())
    subtree = Behavior(name, tuple(numbers.get(port, f"{{{port}}}") for port in arguments)).subtree
    assert subtree is not None
    element = SubElement(root, "BehaviorTree", {"ID": tag})
    _write(element, subtree)
    for leaf in element.iter():
        for port in numbers.keys() & leaf.keys():
            leaf.set(port, f"{{{port}}}")


def _write_models(root: Element, subtasks: Iterable[str], *, turned: bool) -> None:
    """Write the ports of all leaves; those that say how an object is turned only if the tree has any."""
    models = SubElement(root, "TreeNodesModel")
    for tag, name in (LEAVES if turned else {tag: name for name, tag in LEAF_TAGS.items()}).items():
        model = SubElement(models, MODEL_TAGS[SIGNATURES[name].kind], {"ID": tag, "editable": "true"})
        with_turn = turned and (SIGNATURES[name].kind != Kind.GENE or tag in TURNED_TAGS.values())
        for port in SIGNATURES[name].arguments + (SIGNATURES[name].optional if with_turn else ()):
            SubElement(model, "input_port", {"name": port, "type": "std::string"})
    for name in subtasks:
        SubElement(models, "SubTree", {"ID": f"{SUBTASK}{name}", "editable": "true"})


def _write_decorators(root: Element) -> None:
    """Write the ports of those decorators of the tree that BehaviorTree.CPP does not know."""
    used, models = {element.tag for element in root.iter()}, root[-1]
    for kind in EXTENDED.values():
        if kind.kind is not None and kind.port is not None and kind.tag in used:
            model = SubElement(models, "Decorator", {"ID": kind.tag, "editable": "true"})
            SubElement(model, "input_port", {"name": kind.port, "type": "unsigned"})


def _port_text(value: Argument) -> str:
    if isinstance(value, tuple):
        return ";".join(np.format_float_positional(x, trim="-") for x in value)
    return np.format_float_positional(value, trim="-") if isinstance(value, int | float) else str(value)
