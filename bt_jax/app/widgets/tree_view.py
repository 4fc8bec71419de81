"""A tree on the page: in plain words or in symbols, foldable, its nodes coloured by what they returned."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, Protocol, runtime_checkable

from nicegui import ui
from nicegui.element import Element

from bt_jax.app.plain_words import Words
from bt_jax.app.state.edited_tree import Where
from bt_jax.app.widgets.tree_text import STATUS_WORDS, tree_list
from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.drawing.svg import status_class, to_svg
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import children, prefix
from bt_jax.tasks import Task

__all__ = ["Editor", "TreeView"]

LARGE = 12  # nodes; trees that show more begin folded
DEPTH = 3  # below which large trees are folded


class _Drawing(Element, component="../static/tree_view.js"):
    def __init__(self) -> None:
        super().__init__()
        self._props["svg"] = ""
        self._props["text"] = ""
        self._props["classes"] = {}
        self._props["words"] = STATUS_WORDS
        self._props["editing"], self._props["selected"], self._props["off"] = False, "", []

    @property
    def classes_of_nodes(self) -> dict[str, str]:
        """The status classes of the nodes by their ids."""
        return self._props["classes"]

    def draw(self, svg: str, text: str) -> None:
        self._props["svg"], self._props["text"] = svg, text
        self.update()

    def set_editing(self, *, editing: bool, selected: str, off: list[str]) -> None:
        marks = {"editing": editing, "selected": selected, "off": off}
        if any(self._props[key] != value for key, value in marks.items()):
            self._props.update(marks)
            self.update()

    def colour(self, classes: dict[str, str], text: str) -> None:
        if classes != self._props["classes"]:
            self._props["classes"], self._props["text"] = classes, text
            self.update()


@runtime_checkable
class Editor(Protocol):
    """Whoever hears what a person does with the nodes of a tree that they edit; nodes are numbered in prefix order. The
    methods may be coroutines."""

    def select(self, number: int) -> Any: ...

    def key(self, key: str, *, alt: bool) -> Any: ...

    def move(self, number: int, to: int, where: Where) -> Any: ...


class TreeView:
    """A tree with a bar of buttons, drawn into the container that is open; filled by `show` and `colour`.

    `legend` explains the colours. A person may fold and unfold subtrees, and choose words or symbols. Between `edit` and
    `look`, they select and move nodes instead, and `editor` hears of it.
    """

    def __init__(self, *, testid: str, legend: bool = False, editor: Editor | None = None) -> None:
        self._tree: Tree | None = None
        self._task: Task | None = None
        self._words = True
        self._folded: set[str] = set()
        with ui.element("div").classes("tree-view").props(f"data-testid={testid}"):
            with ui.row().classes("tree-bar"):
                if legend:
                    for status, meaning in STATUS_WORDS.items():
                        with ui.element("span").classes(f"tree-legend {status}"):
                            ui.label(meaning)
                ui.space()
                self._unfold = self._button("unfold_more", "Unfold everything", f"{testid}-unfold", self._unfold_all)
                self._fold = self._button("unfold_less", "Fold to the outline", f"{testid}-fold", self._fold_again)
                self._symbols = self._button("code", "Words or symbols", f"{testid}-symbols", self._switch)
            self._drawing = _Drawing()
        self._drawing.on("toggle", lambda event: self._toggle(event.args))
        if editor is not None:
            self._drawing.on("select", lambda event: editor.select(_number(event.args)))
            self._drawing.on("key", lambda event: editor.key(event.args["key"], alt=event.args["alt"]))
            self._drawing.on("move", lambda event: editor.move(*_ends(event.args), event.args["where"]))

    def show(self, tree: Tree | None, task: Task, *, whole: bool = False) -> None:
        """Show a tree of a task, with `whole` also a large one unfolded; the same again changes nothing. With None, the view
        is empty."""
        if tree == self._tree and task == self._task:
            return
        if tree != self._tree:
            self._folded = set() if tree is None else _outline(tree, large=not whole)
            self._drawing.colour({}, "")
        self._tree, self._task = tree, task
        self._draw()

    def colour(self, statuses: Mapping[str, Status | None]) -> None:
        """Colour the nodes; ids as from `encoding.drawing.svg.node_ids`."""
        classes = {name: status_class(status) for name, status in statuses.items()}
        self._drawing.colour(classes, self._text(classes))

    def edit(self, selected: int, off: Collection[int]) -> None:
        """Let a person edit; nodes are numbered in prefix order."""
        self._drawing.set_editing(editing=True, selected=f"node-{selected}", off=[f"node-{number}" for number in off])

    def look(self) -> None:
        """Let a person look only."""
        self._drawing.set_editing(editing=False, selected="", off=[])

    def _draw(self) -> None:
        if self._tree is None or self._task is None:
            self._drawing.draw("", "")
            return
        words = Words(self._task) if self._words else None
        svg = to_svg(self._tree, words=words, folded=self._folded)
        self._drawing.draw(svg, self._text(self._drawing.classes_of_nodes))

    def _text(self, classes: Mapping[str, str]) -> str:
        """Return the tree as a list."""
        if self._tree is None or self._task is None:
            return ""
        return tree_list(self._tree, Words(self._task), classes, self._folded)

    def _toggle(self, name: str) -> None:
        self._folded ^= {name}
        self._draw()

    def _unfold_all(self) -> None:
        self._folded = set()
        self._draw()

    def _fold_again(self) -> None:
        if self._tree is not None:
            self._folded = _outline(self._tree)
            self._draw()

    def _switch(self) -> None:
        self._words = not self._words
        self._draw()

    @staticmethod
    def _button(icon: str, hint: str, testid: str, handler: Callable[[], Any]) -> ui.button:
        button = ui.button(icon=icon, on_click=handler).props(
            f'flat dense size=sm data-testid={testid} aria-label="{hint}"'
        )
        with button:
            ui.tooltip(hint)
        return button


def _number(name: str) -> int:
    return int(name.removeprefix("node-"))


def _ends(moved: Mapping[str, str]) -> tuple[int, int]:
    return _number(moved["node"]), _number(moved["to"])


def _outline(tree: Tree, *, large: bool = True) -> set[str]:
    """Return what is folded at first: genes, and with `large` in a large tree all subtrees below a depth."""
    folded = {f"node-{i}" for i, node in enumerate(prefix(tree)) if isinstance(node, Behavior) and node.subtree}
    if not large or len(prefix(tree)) <= LARGE:
        return folded
    count = 0

    def visit(node: Tree, depth: int) -> None:
        nonlocal count
        index, count = count, count + 1
        if depth >= DEPTH and children(node):
            folded.add(f"node-{index}")
        for child in children(node):
            visit(child, depth + 1)

    visit(tree, 1)
    return folded
