"""Tasks, demonstrations and trees of the workspace: delete and download them, import trees, save and open kits."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.app.panels.keep_runs import FORMATS
from bt_jax.app.panels.parts import button, heading, mark
from bt_jax.app.state.keeping import LARGEST_TREE, TREE_FILES
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.trash import KINDS, Trashable
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.dialogs import ask, dialog
from bt_jax.app.widgets.file_button import file_button
from bt_jax.lfd import DemonstrationFolder
from bt_jax.teaching.kit_file import LARGEST, SUFFIX

__all__ = ["KeptThings"]


class KeptThings:
    """Three lists, and the buttons for files that are imported and shared."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        with ui.row().classes("items-center gap-2"):
            button("Save a kit", "kit-save", "inventory_2", page.guard(self._save_kit))
            file_button(
                *("Open a kit", "kit-open", "unarchive", page),
                endings=[".zip"],
                largest=LARGEST,
                chosen=self._open_kit,
            )
            file_button(
                *("Import a tree", "tree-import", "upload_file", page),
                endings=TREE_FILES,
                largest=LARGEST_TREE,
                chosen=self._import_tree,
            )
        ui.label(
            "A kit is one file with a task, demonstrations and trees, to give to others. A tree is imported for the task "
            "in step 1."
        ).classes("hint")
        self.lists = ui.element("div").classes("keep-lists")
        for topic in ("runs", "task", "demonstrations"):
            page.on(topic, self._show, now=topic == "runs")

    def _show(self) -> None:
        workspace = self.studio.workspace
        sets = {name: _summary(workspace.demonstration_set(name)) for name in workspace.demonstration_sets()}
        trees = {name: self._task_of(name) for name in workspace.learnt_names()}
        self.lists.clear()
        with self.lists:
            self._list("task", "Tasks that you have saved", dict.fromkeys(workspace.own_task_names(), ""))
            self._list("demonstrations", "Demonstrations", sets)
            self._list("tree", "Trees that were learnt from demonstrations or imported", trees)

    def _task_of(self, tree: str) -> str:
        try:
            task = self.studio.workspace.learnt_task(tree)
        except UserError:
            task = None
        return "" if task is None else f"for the task {task.name}"

    def _list(self, kind: Trashable, title: str, things: dict[str, str]) -> None:
        heading(title)
        with ui.element("div").classes("teach-list").props("role=list"):
            for name, summary in things.items():
                self._row(kind, name, summary)
            if not things:
                ui.label("none yet").classes("teach-hint").props("role=listitem")

    def _row(self, kind: Trashable, name: str, summary: str) -> None:
        with mark(ui.element("div").classes("teach-row").props("role=listitem"), f"things-{kind}-{name}"):
            with ui.element("div").classes("teach-what"):
                ui.label(name).classes("text-bold")
                ui.label(summary).classes("teach-hint")
            for ending in FORMATS if kind == "tree" else ():
                load = self.page.guard(functools.partial(self._download, name, ending))
                called = "Text" if ending == "txt" else ending.upper()
                one = button(called, "", "download", load, more="flat")
                mark(one, f"things-{ending}-{name}", aria_label=f"Download {name} as {called}")
            delete = self.page.guard(functools.partial(self._delete, kind, name))
            gone = button("", "", "delete", delete, more="flat")
            mark(gone, f"things-delete-{name}", aria_label=f"Delete {name}", title="Delete")

    def _download(self, name: str, ending: str) -> None:
        ui.download.content(FORMATS[ending](self.studio.workspace.learnt_tree(name)), f"{name}.{ending}")
        self.page.say(f"The tree {name} is in your downloads, as {name}.{ending}.", "success")

    async def _delete(self, kind: Trashable, name: str) -> None:
        if not await ask(f"Move the {KINDS[kind]} {name} into the trash?", yes="Delete", testid="things-delete"):
            return
        if kind == "task":
            await self.studio.delete_task(name)
        else:
            await self.studio.keeping.put_away(kind, name)
        if kind == "demonstrations":
            await self.studio.library.refresh()
        self.page.say(f"The {KINDS[kind]} {name} can be restored from the trash.", "success")

    async def _import_tree(self, file: str, data: bytes) -> None:
        task = self.studio.edited.task
        name = await self.studio.keeping.import_tree(file, data, task)
        self.page.say(f"{name} is imported as a tree for {task.name}; step 6 runs it.", "success")

    async def _open_kit(self, file: str, data: bytes) -> None:
        opened = await self.studio.keeping.open_kit(file, data)
        await self.studio.library.refresh()
        more = [*(f"the demonstrations {name}" for name in opened.sets), *(f"the tree {name}" for name in opened.trees)]
        brought = ", ".join([f"The task {opened.task}", *more])
        self.page.say(f"{brought} {'are' if more else 'is'} here now; step 1 opens the task.", "success")

    async def _save_kit(self) -> None:
        """Ask what belongs to the kit, and let the browser keep it."""
        workspace, task = self.studio.workspace, self.studio.edited.task
        sets = workspace.demonstration_sets()
        trees = [*workspace.run_names(), *workspace.learnt_names()]
        wanted = [self.studio.playing.run] if self.studio.playing.run in trees else []
        used = [self.studio.library.set_name] if self.studio.library.set_name in sets else []
        with dialog("Save a kit") as asked:
            ui.label("Save a kit").classes("text-bold")
            ui.label(f"Task: {task.name}, as it is in step 1").props("data-testid=kit-task")
            of_sets = _several("Demonstrations", "kit-sets", sets, used)
            of_trees = _several("Trees", "kit-trees", trees, wanted)
            with ui.row().classes("self-end gap-2"):
                ui.button("Cancel", on_click=lambda: asked.submit(None)).props("no-caps flat autofocus")
                save = ui.button("Save", on_click=lambda: asked.submit((of_sets.value, of_trees.value)))
                save.props("no-caps unelevated data-testid=kit-save-yes")
        answer = await asked
        if answer is None:
            return
        data = await self.studio.keeping.save_kit(task, *answer)
        ui.download.content(data, f"{task.name}{SUFFIX}")
        self.page.say(f"The kit is in your downloads, as {task.name}{SUFFIX}.", "success")


def _several(label: str, testid: str, options: Sequence[str], value: Sequence[str]) -> ui.select:
    field = ui.select(list(options), label=label, value=list(value), multiple=True)
    return field.props(f"dense outlined use-chips data-testid={testid}").classes("keep-several")


def _summary(folder: DemonstrationFolder) -> str:
    return counted(len(folder.names()), "demonstration")
