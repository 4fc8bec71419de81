"""Reading trees from BehaviorTree.CPP XML, format 4, as we, Groot2 and BehaviorTree.CPP write it."""

from __future__ import annotations

import codecs
import dataclasses
import functools
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import decode_text, read_bytes
from bt_jax._util.words import clipped, listed
from bt_jax.behaviors import EXTENDED, SIGNATURES, Behavior, Control, ExtendedNode, Kind, Tree, not_memoryless
from bt_jax.encoding.formats.depth import TOO_DEEP, check_depth
from bt_jax.encoding.formats.xml import CONTROLS, EXPLICIT, EXTENDED_NAMES, LEAVES, SUBTASK, TURNED
from bt_jax.encoding.limits import MAX_NODES

__all__ = ["from_xml"]

NOT_PORTS = ("ID", "name", "_description", "_fullpath", "_uid", "_autoremap")
MAX_READ_NODES = 20 * MAX_NODES  # genes are read node by node
INSTEAD = {
    "AsyncSequence": "<Sequence>",
    "AsyncFallback": "<Fallback>",
    "SequenceStar": "<SequenceWithMemory>",
    "PipelineSequence": "<ReactiveSequence>",
    "RoundRobin": "<Fallback>",
    "RecoveryNode": "<RetryUntilSuccessful> around a <Fallback>",
    "RetryUntilSuccesful": "<RetryUntilSuccessful>",
    "Precondition": "a condition before it in a <ReactiveSequence>",
    "IfThenElse": "a <Fallback> of <Sequence>",
    "WhileDoElse": "a <ReactiveFallback> of <ReactiveSequence>",
    "Parallel": "<ReactiveSequence>, one action runs at a time",
    "ParallelAll": "<ReactiveSequence>, one action runs at a time",
    "Delay": "no delay, actions wait for each other",
    "Sleep": "no delay, actions wait for each other",
    "SubTreePlus": "<SubTree>",
}
UNKNOWN = Behavior("open_gripper")  # stands for an unknown node until all of them are known
_DECLARED = re.compile(rb"^\s*<\?xml[^>]*?encoding\s*=\s*[\"']([\w.:-]+)[\"']")


def from_xml(source: str | Path) -> Tree:
    """Read a tree from XML text or from the path of a file.

    SubTrees are replaced by what they stand for, except that one which is what a gene stands for becomes that gene.
    Raise UserError, with line and remedy, if the text is not XML of this format or holds unknown nodes.
    """
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        text, where = source, "XML"
    elif isinstance(source, str) and "\n" in source:
        raise UserError(f"{source[:40]!r} is not XML; give XML text, or the path of a file")
    else:
        text, where = _decoded(read_bytes(Path(source)), str(source)), str(source)
    try:
        tree = _Reader(text, where).main_tree()
    except RecursionError:
        raise UserError(f"{where}: {TOO_DEEP}") from None
    try:
        return check_depth(tree)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error


def _decoded(data: bytes, where: str) -> str:
    """Return the text of an XML document in the encoding that it declares, or whose mark it begins with."""
    declared = _DECLARED.match(data[:1000])
    if declared is None:
        wide = {b"<\0?\0": codecs.BOM_UTF16_LE, b"\0<\0?": codecs.BOM_UTF16_BE}.get(data[:4], b"")
        return decode_text(wide + data, where)
    name = declared[1].decode("ascii")
    if re.fullmatch(r"(utf|ucs)[_-]?(16|32|2|4)([_-]?(le|be))?", name, re.IGNORECASE):
        return decode_text(data, where)  # the declaration itself is not in that encoding; .NET's StringWriter names it
    try:
        return data.decode(name)
    except (LookupError, UnicodeError, ValueError) as error:
        problem = "is not known" if isinstance(error, LookupError) else "does not fit the text"
        raise UserError(
            f"{where}: its encoding '{name}' {problem}; save it as UTF-8, with encoding=\"UTF-8\""
        ) from error


@dataclasses.dataclass(frozen=True)
class _Scope:
    """Where a node stands: the ports of the tree around it, and the trees it is in, from the outermost."""

    ports: Mapping[str, str]
    inside: tuple[str, ...] = ()


class _Reader:
    """One document, with the line of each element for messages. Unknown nodes are collected and refused together."""

    def __init__(self, text: str, where: str):
        self.where = where
        self.lines: dict[Element, int] = {}
        self.unknown: dict[str, Element] = {}
        self.num_nodes = 0
        self.root = self._parse(text)
        self.trees: dict[str, Element] = {}
        self._check()

    def fail(self, element: Element, problem: str) -> NoReturn:
        raise UserError(f"{self.where}, line {self.lines[element]}: {clipped(problem)}")

    def _parse(self, text: str) -> Element:
        builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
        document = text.lstrip("\ufeff \t\r\n")
        above = text[: len(text) - len(document)].count("\n")

        def start(tag: str, attributes: dict[str, str]) -> None:
            self.lines[builder.start(tag, attributes)] = above + parser.CurrentLineNumber

        parser.StartElementHandler = start
        parser.EndElementHandler = builder.end
        try:
            parser.Parse(document.encode("utf-8", "replace").decode("utf-8"), True)
        except expat.ExpatError as error:
            problem = expat.ErrorString(error.code)
            raise UserError(f"{self.where}, line {above + error.lineno}: not XML ({problem}); fix that line") from error
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
                if name in self.trees and _canonical(element) != _canonical(self.trees[name]):
                    self.fail(element, f"a second, different <BehaviorTree> has the ID '{name}'; rename one")
                self.trees.setdefault(name, element)
        if not self.trees:
            self.fail(root, "there is no <BehaviorTree>; add one")

    def main_tree(self) -> Tree:
        name = self.root.get("main_tree_to_execute")
        if name is None:
            name = self._only_root()
        if name not in self.trees:
            names = ", ".join(self.trees)
            self.fail(self.root, f"there is no main tree '{name}'; set main_tree_to_execute to one of {names}")
        tree = self.definition(name, _Scope({}))
        self._refuse_unknown()
        return tree

    def _only_root(self) -> str:
        """Return the tree that is part of no other, where editors have dropped which one is the main tree."""
        inner = [element for tree in self.trees.values() for element in tree.iter() if element is not tree]
        used = {element.get("ID", element.tag) for element in inner}
        roots = [name for name in self.trees if name not in used]
        if len(roots) == 1:
            return roots[0]
        names = ", ".join(roots or self.trees)
        self.fail(self.root, f"which tree is the main one? set main_tree_to_execute to one of {names}")

    def _refuse_unknown(self) -> None:
        if not self.unknown:
            return
        known = ", ".join([*CONTROLS, *EXTENDED_NAMES, *LEAVES])
        instead = [f"{INSTEAD[tag]} in place of <{tag}>" for tag in self.unknown if tag in INSTEAD]
        if len(instead) < len(self.unknown):
            instead.append(f"one of {known}")
        tags, elements = list(self.unknown), list(self.unknown.values())
        others = [f"<{tag}> (line {self.lines[element]})" for tag, element in zip(tags[1:], elements[1:], strict=True)]
        names = listed([f"<{tags[0]}>", *others])
        self.fail(elements[0], f"unknown node{'s' if others else ''} {names}; use {', '.join(instead)}")

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
        read = functools.partial(self.node, scope=scope)  # of few calls a level, so that trees may be deep
        if tag in CONTROLS:
            if len(element) == 0:
                self.fail(element, f"<{tag}> has no children; add some or delete it")
            return Control(CONTROLS[tag], tuple(map(read, element)))
        if tag in EXTENDED_NAMES:
            return self.extended(element, EXTENDED_NAMES[tag], tuple(map(read, element)), scope)
        if element.tag != "SubTree" and tag not in self.trees and tag not in LEAVES:
            self.unknown.setdefault(tag, element)
            tuple(map(read, element))
            return UNKNOWN
        if len(element):
            self.fail(element, f"<{tag}> takes no nodes inside it; put both into a <ReactiveSequence>")
        if element.tag == "SubTree" or tag in self.trees:
            return self.subtree(element, tag, scope)
        return self.leaf(element, tag, self.values(element, scope.ports))

    def extended(self, element: Element, name: str, below: tuple[Tree, ...], scope: _Scope) -> Tree:
        port, values = EXTENDED[name].port, self.values(element, scope.ports)
        tag, number = EXTENDED[name].tag, None
        for other in values.keys() - {port}:
            self.fail(element, f"<{tag}> has no port {other}; delete it")
        if port is not None and port not in values:
            self.fail(element, f'<{tag}> lacks the port {port}; add {port}="..."')
        if port is not None:
            try:
                number = int(values[port])
            except ValueError:
                self.fail(element, f"<{tag}>: '{values[port]}' is not a whole number; correct {port}")
        try:
            return ExtendedNode(name, below, number)
        except UserError as error:
            self.fail(element, str(error))

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
        if name.startswith(SUBTASK) and not values and not_memoryless(tree) is None:
            return Behavior("subtask", (name.removeprefix(SUBTASK), tree))
        if is_gene and set(values) == set(_ports(name)):
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
        wanted = _ports(tag)
        if SIGNATURES[name].kind != Kind.GENE:
            wanted += tuple(port for port in SIGNATURES[name].optional if port in values)
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

    def value(self, element: Element, port: str, text: str) -> str | float | tuple[float, float, float]:
        if port == "turn":
            try:
                return float(text)
            except ValueError:
                self.fail(element, f"'{text}' is not a turn; write degrees, as 90")
        if port != "position":
            return text.strip()
        try:
            x, y, z = map(float, text.split(";"))
        except ValueError:
            x = y = z = math.nan
        if not np.all(np.isfinite((x, y, z))):
            self.fail(element, f"'{text}' is not a position; write three numbers in metres, as 0;0;0.1")
        return x, y, z


def _ports(tag: str) -> tuple[str, ...]:
    """Return the ports that a leaf must have."""
    signature = SIGNATURES[LEAVES[tag]]
    return signature.arguments + (signature.optional if tag.endswith(TURNED) else ())


def _canonical(element: Element) -> Any:
    """Return what two definitions have in common where they mean the same: all but names, paths and positions."""
    ports = {key: value for key, value in element.items() if key not in NOT_PORTS or key in ("ID", "_autoremap")}
    return element.tag, ports, list(map(_canonical, element))
