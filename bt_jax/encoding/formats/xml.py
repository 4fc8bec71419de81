"""Trees as BehaviorTree.CPP XML, format 4, which Groot2 opens and BehaviorTree.CPP executes.

Memoryless control nodes are ReactiveSequence and ReactiveFallback there; plain Sequence and Fallback remember a running
child, which our trees do not, so they are refused. Leaves are compact tags with ports, `<Pick object="YellowBox"/>`;
positions are written "x;y;z", as BehaviorTree.CPP writes vectors. A gene is a `<SubTree ID="Move" .../>` with one
`<BehaviorTree ID="Move">` whose leaves read the ports as `{object}`; a subtask is a `<SubTree ID="Subtask_NAME"/>`.
Some 4.x releases forbid two running children in a ReactiveSequence unless the program calls
`BT::ReactiveSequence::EnableException(false)`.

Format: https://www.behaviortree.dev/docs/learn-the-basics/xml_format
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import SIGNATURES, Argument, Behavior, Control, Kind, Tree, expand
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import prefix

__all__ = ["from_xml", "to_xml"]

CONTROLS = {"ReactiveSequence": Kind.SEQUENCE, "ReactiveFallback": Kind.FALLBACK}
CONTROL_TAGS = {kind: tag for tag, kind in CONTROLS.items()}
SUBTASK = "Subtask_"
LEAF_TAGS = {name: "".join(word.title() for word in name.split("_")) for name in SIGNATURES if name != "subtask"}
LEAVES = {tag: name for name, tag in LEAF_TAGS.items()}
EXPLICIT = ("Action", "Condition", "Control", "SubTree")
MODEL_TAGS = {Kind.CONDITION: "Condition", Kind.ACTION: "Action", Kind.GENE: "SubTree"}
WITH_MEMORY = ("Sequence", "Fallback", "SequenceWithMemory", "AsyncSequence", "AsyncFallback")
NOT_PORTS = ("ID", "name", "_description", "_fullpath", "_uid", "_autoremap")
MAX_READ_NODES = 20 * MAX_NODES  # genes are read node by node


def to_xml(tree: Tree, *, name: str = "MainTree", expand_genes: bool = False) -> str:
    """Return the tree as an XML document whose main tree is called `name`; `from_xml` reads it back to an equal tree.

    `expand_genes` writes the subtree of each gene in its place instead of a SubTree; that is then what is read back.
    Raise UserError if `name` cannot be a tree's name.
    """
    taken = {*CONTROLS, *LEAVES, *EXPLICIT, *WITH_MEMORY}
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
    _write_models(root, subtasks)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _genes(tree: Tree) -> tuple[dict[str, Tree], set[str]]:
    """The subtasks in a tree, by name, and the names of the other genes, also those inside of subtasks. Raise UserError
    if two different subtasks have one name."""
    subtasks: dict[str, Tree] = {}
    genes: set[str] = set()
    open_ = [tree]
    while open_:
        for node in prefix(open_.pop()):
            if isinstance(node, Control) or node.kind != Kind.GENE:
                continue
            if node.body is None:
                genes.add(node.name)
            elif node.label not in subtasks:
                subtasks[node.label] = node.body
                open_.append(node.body)
            elif subtasks[node.label] != node.body:
                raise UserError(f"two different subtasks are called '{node.label}'; rename one of them")
    return subtasks, genes


def _write(parent: Element, node: Tree) -> None:
    if isinstance(node, Control):
        element = SubElement(parent, CONTROL_TAGS[node.kind])
        for child in node.children:
            _write(element, child)
        return
    if node.name == "subtask":
        SubElement(parent, "SubTree", {"ID": f"{SUBTASK}{node.label}"})
        return
    ports = {port: _port_text(value) for port, value in zip(SIGNATURES[node.name].arguments, node.args, strict=True)}
    if node.kind == Kind.GENE:
        SubElement(parent, "SubTree", {"ID": LEAF_TAGS[node.name], **ports})
    else:
        SubElement(parent, LEAF_TAGS[node.name], ports)


def _write_gene(root: Element, name: str) -> None:
    """Write the subtree of a gene with ports in place of its arguments: expanded with the values below as stand-ins,
    which no other leaf of the subtree has."""
    arguments = SIGNATURES[name].arguments
    stand_ins = {port: (0.0, 0.0, 0.0) if port == "position" else f"{{{port}}}" for port in arguments}
    subtree = Behavior(name, tuple(stand_ins.values())).subtree
    assert subtree is not None
    element = SubElement(root, "BehaviorTree", {"ID": LEAF_TAGS[name]})
    _write(element, subtree)
    for leaf in element.iter():
        if "position" in leaf.attrib:
            leaf.set("position", "{position}")


def _write_models(root: Element, subtasks: Iterable[str]) -> None:
    models = SubElement(root, "TreeNodesModel")
    for name, tag in LEAF_TAGS.items():
        model = SubElement(models, MODEL_TAGS[SIGNATURES[name].kind], {"ID": tag, "editable": "true"})
        for port in SIGNATURES[name].arguments:
            SubElement(model, "input_port", {"name": port, "type": "std::string"})
    for name in subtasks:
        SubElement(models, "SubTree", {"ID": f"{SUBTASK}{name}", "editable": "true"})


def _port_text(value: Argument) -> str:
    if isinstance(value, tuple):
        return ";".join(np.format_float_positional(x, trim="-") for x in value)
    return str(value)


def from_xml(source: str | Path) -> Tree:
    """Read a tree from XML text or from the path of a file.

    SubTrees are replaced by what they stand for, except that one which is what a gene stands for becomes that gene.
    Raise UserError, with line and remedy, if the text is not XML of this format or holds unknown nodes.
    """
    text: str | bytes
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        text, where = source.lstrip("\ufeff \t\r\n"), "XML"
    else:
        where = str(source)
        try:
            text = Path(source).read_bytes()
        except (OSError, ValueError) as error:
            raise UserError(f"{str(source)[:80]!r} is not XML and cannot be read as a file; check the path") from error
    try:
        return _Reader(text, where).main_tree()
    except RecursionError:
        raise UserError(f"{where}: the tree is nested too deeply; make it flatter") from None


@dataclasses.dataclass(frozen=True)
class _Scope:
    """Where a node stands: the ports of the tree around it, and the trees it is in, from the outermost."""

    ports: Mapping[str, str]
    inside: tuple[str, ...] = ()


class _Reader:
    """One document, with the line of each element for messages."""

    def __init__(self, text: str | bytes, where: str):
        self.where = where
        self.lines: dict[Element, int] = {}
        self.num_nodes = 0
        self.root = self._parse(text)
        self.trees: dict[str, Element] = {}
        self._check()

    def fail(self, element: Element, problem: str) -> NoReturn:
        raise UserError(f"{self.where}, line {self.lines[element]}: {problem}")

    def _parse(self, text: str | bytes) -> Element:
        builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()

        def start(tag: str, attributes: dict[str, str]) -> None:
            self.lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

        parser.StartElementHandler = start
        parser.EndElementHandler = builder.end
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            problem = expat.ErrorString(error.code)
            raise UserError(f"{self.where}, line {error.lineno}: not XML ({problem}); fix that line") from error
        return builder.close()

    def _check(self) -> None:
        root = self.root
        if root.tag != "root" or root.get("BTCPP_format") != "4":
            self.fail(root, 'the document must start with <root BTCPP_format="4">; convert or correct it')
        for element in root:
            if element.tag == "include":
                self.fail(element, "<include> is not supported; copy that file's <BehaviorTree> in here")
            if element.tag == "BehaviorTree":
                name = element.get("ID", "")
                if name in self.trees:
                    self.fail(element, f"a second <BehaviorTree> has the ID '{name}'; rename one")
                self.trees[name] = element
        if not self.trees:
            self.fail(root, "there is no <BehaviorTree>; add one")

    def main_tree(self) -> Tree:
        name = self.root.get("main_tree_to_execute")
        if name is None and len(self.trees) > 1:
            names = ", ".join(self.trees)
            self.fail(self.root, f"which tree is the main one? set main_tree_to_execute to one of {names}")
        name = next(iter(self.trees)) if name is None else name
        if name not in self.trees:
            names = ", ".join(self.trees)
            self.fail(self.root, f"there is no main tree '{name}'; set main_tree_to_execute to one of {names}")
        return self.definition(name, _Scope({}))

    def definition(self, name: str, scope: _Scope) -> Tree:
        """Return the tree that <BehaviorTree ID=name> defines."""
        element = self.trees[name]
        if len(element) != 1:
            self.fail(element, f"<BehaviorTree ID='{name}'> has {len(element)} nodes at its top; it must have one")
        return self.node(element[0], dataclasses.replace(scope, inside=(*scope.inside, name)))

    def node(self, element: Element, scope: _Scope) -> Tree:
        self.num_nodes += 1
        if self.num_nodes > MAX_READ_NODES:
            self.fail(element, f"the tree has more than {MAX_READ_NODES} nodes, SubTrees written out; make it smaller")
        tag = element.get("ID") if element.tag in EXPLICIT else element.tag
        if tag is None:
            self.fail(element, f"<{element.tag}> has no ID; add it")
        for attribute in element.attrib:
            if attribute.startswith("_") and attribute not in NOT_PORTS:
                self.fail(element, f"the script in {attribute} is not supported; write it as a condition in the tree")
        if tag in CONTROLS:
            if len(element) == 0:
                self.fail(element, f"<{tag}> has no children; add some or delete it")
            return Control(CONTROLS[tag], tuple(self.node(child, scope) for child in element))
        if tag in WITH_MEMORY:
            other = "ReactiveFallback" if "Fallback" in tag else "ReactiveSequence"
            self.fail(element, f"<{tag}> remembers which child was running, which our trees do not; use <{other}>")
        if len(element):
            self.fail(element, f"<{tag}> cannot have children; delete them")
        if element.tag == "SubTree" or tag in self.trees:
            return self.subtree(element, tag, scope)
        if tag not in LEAVES:
            self.fail(element, f"unknown node <{tag}>; use one of {', '.join([*CONTROLS, *LEAVES])}")
        return self.leaf(element, tag, self.values(element, scope.ports))

    def subtree(self, element: Element, name: str, scope: _Scope) -> Tree:
        values = self.values(element, scope.ports)
        if element.get("_autoremap", "").lower() in ("true", "1"):
            values = {**scope.ports, **values}
        is_gene = name in LEAVES and SIGNATURES[LEAVES[name]].kind == Kind.GENE
        if name not in self.trees:
            if is_gene:
                return self.leaf(element, name, values)
            self.fail(element, f"there is no <BehaviorTree ID='{name}'>; add it, or use one of {', '.join(self.trees)}")
        if name in scope.inside:
            circle = " > ".join([*scope.inside, name])
            self.fail(element, f"the tree {name} contains itself ({circle}); break the circle")
        tree = self.definition(name, dataclasses.replace(scope, ports=values))
        if name.startswith(SUBTASK) and not values:
            return Behavior("subtask", (name.removeprefix(SUBTASK), tree))
        if is_gene and set(values) == set(SIGNATURES[LEAVES[name]].arguments):
            gene = self.leaf(element, name, values)
            return gene if gene.subtree == tree else tree
        return tree

    def values(self, element: Element, ports: Mapping[str, str]) -> dict[str, str]:
        """Ports of an element, `{name}` replaced by the value of that port of the tree around it."""
        found = {}
        for port, text in element.items():
            if port in NOT_PORTS:
                continue
            if text.startswith("{") and text.endswith("}"):
                wanted = port if text == "{=}" else text[1:-1].strip()
                if wanted not in ports:
                    self.fail(element, f'there is no value for {port}="{text}"; give the SubTree around it that port')
                text = ports[wanted]
            found[port] = text
        return found

    def leaf(self, element: Element, tag: str, values: Mapping[str, str]) -> Behavior:
        name = LEAVES[tag]
        wanted = SIGNATURES[name].arguments
        for port in wanted:
            if port not in values:
                self.fail(element, f'<{tag}> lacks the port {port}; add {port}="..."')
        for port in values:
            if port not in wanted:
                self.fail(element, f"<{tag}> has no port {port}; delete it or use {', '.join(wanted) or 'no port'}")
        arguments = tuple(self.value(element, port, values[port]) for port in wanted)
        try:
            return Behavior(name, arguments)
        except UserError as error:
            self.fail(element, str(error))

    def value(self, element: Element, port: str, text: str) -> str | tuple[float, float, float]:
        if port != "position":
            return text.strip()
        try:
            x, y, z = map(float, text.split(";"))
        except ValueError:
            x = y = z = math.nan
        if not np.all(np.isfinite((x, y, z))):
            self.fail(element, f"'{text}' is not a position; write three numbers in metres, as 0;0;0.1")
        return x, y, z
