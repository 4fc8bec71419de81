"""Does BehaviorTree.CPP tick our exports as we tick the trees? Random trees with random leaf statuses through both.

pip install behaviortreepy  (Python bindings of BehaviorTree.CPP)
python -m benchmarks.btcpp
"""

from __future__ import annotations

import ctypes
import dataclasses
import random
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import behaviortreepy
import tyro

from benchmarks._report import report
from bt_jax.behaviors import EXTENDED, Behavior, Control, ExtendedNode, Kind, Tree
from bt_jax.encoding.formats.xml import LEAVES, to_xml
from bt_jax.encoding.interpret import MAX_PASSES, TreeMemory, tick_tree
from bt_jax.encoding.status import Status

ACTIONS = [Behavior("pick", (f"Box{i}",)) for i in range(8)]
MEMORYLESS = ("Sequence", "Fallback")
NUMBERS = {"RetryUntilSuccessful": (1, 2, 3), "Repeat": (1, 2, 3), "Timeout": (0, 10**7)}
ITS_OWN = [name for name, kind in EXTENDED.items() if kind.kind is None]  # it has no retry and timeout over ticks
LIBRARY = next(Path(behaviortreepy.__file__).parent.glob("_behaviortreepy*.so"))


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Random trees through BehaviorTree.CPP and through our own tick."""

    trees: int = 2000
    """number of trees of each kind"""
    ticks: int = 8
    """ticks of each tree"""
    seed: int = 0
    """random seed"""
    out: Path | None = None
    """JSON file to write"""


class Cpp:
    """BehaviorTree.CPP with our actions as its nodes; `asked` are those that were ticked, `statuses` what they return."""

    def __init__(self) -> None:
        self.asked: list[int] = []
        self.statuses: list[Status] = []
        self.factory = behaviortreepy.BehaviorTreeFactory()
        for i in range(len(ACTIONS)):
            self.factory.register_simple_stateful_action(f"Pick{i}", self._ticked(i), self._ticked(i))

    def _ticked(self, i: int) -> Any:
        def tick(_: Any) -> Any:
            self.asked.append(i)
            return getattr(behaviortreepy.NodeStatus, self.statuses[i].name)

        return tick

    def load(self, tree: Tree) -> Any:
        """Return the tree that it reads from our export. The bindings know no ports: a leaf is told by its name."""
        root = ElementTree.fromstring(to_xml(tree))
        for element in root.iterfind("BehaviorTree//*"):
            if element.tag in LEAVES:
                element.tag, element.attrib = f"Pick{element.attrib['object'].removeprefix('Box')}", {}
        root.remove(root.findall("TreeNodesModel")[0])
        return self.factory.create_tree_from_text(ElementTree.tostring(root, encoding="unicode"))

    @staticmethod
    def enable_exception(enable: bool) -> None:
        """Have it throw where another child of a reactive node is RUNNING than in the tick before."""
        for name in ("16ReactiveSequence", "16ReactiveFallback"):
            getattr(ctypes.CDLL(str(LIBRARY)), f"_ZN2BT{name}15EnableExceptionEb")(ctypes.c_bool(enable))


def main(arguments: Arguments) -> None:
    rows = []
    for kind, names in (("Sequence and Fallback", MEMORYLESS), ("all nodes", (*MEMORYLESS * 2, *ITS_OWN))):
        rows.append({"nodes": kind, **_compare(arguments, names)})
    report("btcpp", "Trees ticked by BehaviorTree.CPP", rows, out=arguments.out, bindings=behaviortreepy.__version__)


def _compare(arguments: Arguments, names: tuple[str, ...]) -> dict[str, int]:
    """Return how many ticks were compared, and how many had the same status and the same ticked leaves; then, in how many
    trees it throws if it is told to."""
    cpp, rng = Cpp(), random.Random(arguments.seed)
    compared = same = endless = thrown = 0
    for _ in range(arguments.trees):
        tree = _random_tree(rng, names, rng.randint(1, 14))
        loaded, strict = cpp.load(tree), cpp.load(tree)
        memory, quiet = TreeMemory(), True
        for _ in range(arguments.ticks):
            cpp.statuses = rng.choices(list(Status), (0.35, 0.4, 0.25), k=len(ACTIONS))
            asked: list[int] = []
            tick = tick_tree(tree, lambda leaf, _, asked=asked: _status(cpp, asked, leaf), memory)
            memory = tick.memory
            if len(asked) >= MAX_PASSES:  # it would not return from this tick
                endless += 1
                break
            cpp.asked.clear()
            status = loaded.tick_once()
            compared += 1
            same += status.name == tick.status.name and cpp.asked == asked
            quiet = quiet and _is_quiet(cpp, strict)
        thrown += not quiet
    return {"trees": arguments.trees, "ticks": compared, "same": same, "without end": endless, "throw": thrown}


def _status(cpp: Cpp, asked: list[int], leaf: Behavior) -> Status:
    asked.append(ACTIONS.index(leaf))
    return cpp.statuses[asked[-1]]


def _is_quiet(cpp: Cpp, tree: Any) -> bool:
    """Tick a tree with exceptions enabled; return whether there was none."""
    cpp.enable_exception(True)
    try:
        tree.tick_once()
    except RuntimeError:
        return False
    finally:
        cpp.enable_exception(False)
    return True


def _random_tree(rng: random.Random, names: tuple[str, ...], size: int) -> Tree:
    """Return a tree of about so many nodes."""
    if size <= 1:
        return rng.choice(ACTIONS)
    name = rng.choice(names)
    if name in EXTENDED and EXTENDED[name].one_child:
        number = rng.choice(NUMBERS[name]) if name in NUMBERS else None
        return ExtendedNode(name, (_random_tree(rng, names, size - 1),), number)
    count = rng.randint(1, min(3, size - 1))
    below = tuple(_random_tree(rng, names, (size - 1) // count) for _ in range(count))
    return Control(Kind[name.upper()], below) if name in MEMORYLESS else ExtendedNode(name, below)


if __name__ == "__main__":
    main(tyro.cli(Arguments, prog="python -m benchmarks.btcpp"))
