"""Step 6: watch a tree at work; play, pause, step, look back, and move objects while it runs."""

from __future__ import annotations

import functools

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.correct import Correct
from bt_jax.app.panels.parts import button, may_leave
from bt_jax.app.panels.run_words import said, verdict
from bt_jax.app.plain_words import Words
from bt_jax.app.state.goals import target_keys
from bt_jax.app.state.playing import SPEEDS
from bt_jax.app.state.scene_words import THERE, target_state
from bt_jax.app.state.snapping import snapped
from bt_jax.app.state.spots import Spot, origins, references, spot_at
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import Step
from bt_jax.app.widgets.holder_line import holder_line
from bt_jax.app.widgets.place_fields import PlaceFields
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.training.settings import UNSEEN

__all__ = ["build"]

LESSON = "what was demonstrated"
OWN = "corrected by hand"


def build(studio: Studio, page: PanelContext) -> None:
    """Build the choice of a tree, the controls, the timeline, what happens, and the tree."""
    _Run(studio, page)


class _Run:
    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page = studio, page
        self._drawn = -1  # number of the layout that was drawn last
        self.scrubbing, self.wanted = False, 0
        self.learnt: dict[str, str] = {}
        self.fields: PlaceFields | None = None
        guard = functools.partial(page.guard, steers="run")
        with ui.element("div").classes("run"):
            holder_line(studio.holds, page, "run")
            with ui.row().classes("items-center gap-2 w-full no-wrap"):
                self.source = (
                    ui.select([], label="Tree of")
                    .on("update:model-value", guard(self._choose))
                    .props("dense outlined options-dense data-testid=run-source")
                    .classes("run-source")
                )
                self.over = button("Start over", "run-restart", "replay", guard(self._restart))
                self.other = button("Other start", "run-layout", "shuffle", guard(self._other_layout))
            with ui.row().classes("items-center gap-2 w-full no-wrap"):
                self.toggle = button("Play", "run-play", "play_arrow", guard(self._toggle))
                self.step = button("One tick", "run-tick", "skip_next", guard(self._tick))
                ui.select(
                    {speed: f"{speed:g} \N{MULTIPLICATION SIGN}" for speed in SPEEDS},
                    label="Speed",
                    on_change=lambda event: studio.playing.set_speed(event.value),
                ).props("dense outlined options-dense data-testid=run-speed").classes("run-speed").bind_value_from(
                    studio.playing, "speed"
                )
                self.timeline = (
                    ui.slider(min=0, max=1, value=0)
                    .on("update:model-value", guard(self._scrub))
                    .props('data-testid=run-timeline markers snap aria-label="Timeline"')
                    .classes("run-timeline")
                )
            self.what = ui.label().classes("run-what").props("data-testid=run-what aria-live=polite")
            with ui.row().classes("gap-2") as self.targets:
                pass
            self.verdict = ui.label().props("data-testid=run-verdict")
            with ui.row().classes("items-center gap-2") as self.hint:
                self.drag = ui.label().classes("hint")
                self.hand = (
                    ui.select([], label="or by numbers", clearable=True)
                    .on("update:model-value", page.guard(self._take))
                    .props("dense outlined options-dense data-testid=run-box")
                    .classes("run-box")
                )
            with ui.row().classes("items-center gap-2 no-wrap") as self.numbers:
                pass
            self.correct = Correct(studio, page)
            self.tree = TreeView(testid="run-tree", legend=True, editor=self.correct)
        page.on("tree", self._sources)
        page.on("runs", self._sources, now=False)
        page.on("lesson", self._sources, now=False)
        page.on("player", self._refresh)
        page.on("correction", self._sources, now=False)
        page.on("holds", self._refused, now=False)
        page.on_step(self._enter)
        page.scene.on_drop(self._drop)

    def _enter(self, step: Step) -> None:
        if step == "run":
            self._sources()
            if self.studio.playing.player is None:
                ui.timer(0.0, self.page.guard(self._prepare), once=True)

    async def _prepare(self) -> None:
        """Make the tree ready to run."""
        if self.studio.playing.tree is not None:
            await self.studio.playing.begin(again=False)
        self._refresh()

    def _sources(self) -> None:
        """List the trees to choose from: those of the runs, and the demonstrated one."""
        studio, lesson = self.studio, self.studio.library.lesson
        self.learnt = {f"tree: {name}": name for name in studio.workspace.learnt_names()}
        own = studio.correction.part is not None
        options = [
            *([OWN] if own else []),
            *studio.workspace.run_names(),
            *([LESSON] if lesson is not None else []),
            *self.learnt,
        ]
        here = OWN if own else studio.playing.run
        if here is None and studio.playing.tree is not None:
            here = LESSON if lesson is not None and studio.playing.tree == lesson.tree else self.source.value
        self.source.set_options(options, value=here if here in options else None)
        self._refresh()

    def _refused(self) -> None:
        """Show what runs, instead of what was chosen in vain, while another window steers it."""
        if self.studio.holds.other("run", self.page.window) is not None:
            self._sources()

    async def _choose(self) -> None:
        studio, name = self.studio, self.source.value
        try:
            if name == OWN:
                return
            studio.correction.end()
            if name == LESSON:
                if studio.library.lesson is None:
                    raise UserError("nothing has been learnt yet; give demonstrations in step 3")
                studio.take_tree(studio.library.lesson.tree, None)
            elif name in self.learnt:
                studio.take_tree(studio.workspace.learnt_tree(self.learnt[name]), None)
            elif studio.workspace.run(name).config().task == studio.edited.task:
                studio.open_run(name)
            else:
                self.page.steer("task")
                if not await may_leave(studio):
                    return
                self.page.steer("task")  # again: a person may take their time to answer
                studio.open_run(name)
            await studio.playing.begin()
        finally:
            self._sources()

    async def _restart(self) -> None:
        player = self.studio.playing.player
        if player is None:
            await self.studio.playing.begin()
        else:
            await self.studio.playing.begin(player.snapshots[0].episode.world, player.fate)

    async def _other_layout(self) -> None:
        self._drawn += 1
        await self.studio.playing.begin(sample_layouts(self.studio.edited.task, [UNSEEN, self._drawn], 1))

    async def _tick(self) -> None:
        await self.studio.playing.begin(again=False)
        await self.studio.playing.tick()

    async def _toggle(self) -> None:
        if self.studio.playing.player is None:
            await self.studio.playing.begin(again=False)
        if self.studio.playing.on:
            self.studio.playing.pause()
        else:
            self.studio.playing.play()

    async def _scrub(self, event: GenericEventArguments) -> None:
        """Show the snapshot that the timeline is at; a person may move it on meanwhile. The event carries its position
        earlier than the slider's value, which is sent a few times a second."""
        self.wanted = int(event.args)
        if self.scrubbing:
            return
        self.scrubbing = True
        try:
            while (player := self.studio.playing.player) is not None and player.at != min(
                self.wanted, len(player.snapshots) - 1
            ):
                await self.studio.playing.seek(self.wanted)
        finally:
            self.scrubbing = False
            self._refresh()

    def _take(self) -> None:
        """Show fields for the place of the chosen object."""
        self.numbers.clear()
        self.fields, player, task = None, self.studio.playing.player, self.studio.edited.task
        if self.hand.value not in task.object_names or player is None:
            return
        name = self.hand.value
        thing = task.thing(name)
        with self.numbers:
            spot = spot_at(task, player.world, name)
            moved = functools.partial(self._move, name)
            turns = bool(thing.symmetry) and not thing.is_cube
            self.fields = PlaceFields(self.page, name, references(task, name), spot, moved, step="run", turns=turns)

    async def _move(self, name: str, spot: Spot) -> None:
        self.page.steer("run")
        task = self.studio.edited.task
        await self.studio.playing.put(
            name, lambda world: spot.point(task, name, origins(task, world, ended=False)), spot.turn
        )

    async def _drop(self, dragged: str, name: str, position: np.ndarray) -> None:
        if self.page.step != "run":
            return
        player = self.studio.playing.player
        if player is None:
            raise UserError("nothing runs yet; press Play first, or arrange the start in step 1")
        self.page.steer("run")
        found = snapped(player.task, player.world, name, position)
        if found is None:
            await self.studio.playing.put(name, lambda world: position)
        else:
            await self.studio.playing.put(name, lambda world: found.position, found.turn)
            self.page.say(f"{name} is put into {found.slot}.", "success")

    def _refresh(self) -> None:
        studio, player = self.studio, self.studio.playing.player
        on = studio.playing.on
        self.toggle.set_text("Pause" if on else "Play")
        self.toggle.props(f"icon={'pause' if on else 'play_arrow'}")
        for control in (self.toggle, self.step, self.over, self.other):
            control.set_enabled(studio.playing.tree is not None)
        self.hint.set_visibility(player is not None)
        words = Words(studio.edited.task)
        self.drag.set_text(f"Drag {words.a_thing} in the scene at any time, and watch how the tree reacts.")
        if studio.correction.part is None:
            self.tree.show(studio.playing.tree if player is None else player.tree, studio.edited.task)
        self.correct.show(self.tree)
        self.targets.clear()
        names = list(studio.edited.task.object_names)
        if self.hand.options != names or (player is None and self.hand.value is not None):
            self.hand.set_options(names, value=None)
            self._take()
        if player is None:
            self._set_timeline(0, 1)
            self.what.set_text(
                "" if studio.playing.tree else "There is no tree yet: evolve one first, or choose a run above."
            )
            self.verdict.set_text("")
            return
        self._set_timeline(player.at, len(player.snapshots) - 1)
        self.what.set_text(said(words, player))
        self.verdict.set_text(verdict(studio, player))
        self.tree.colour(self.correct.statuses(player))
        if self.fields is not None:
            self.fields.show(spot_at(studio.edited.task, player.world, self.hand.value))
        with self.targets:
            for (key, target), state in zip(
                target_keys(player.task).items(), target_state(player.task, player.world), strict=True
            ):
                _target(f"{target.object} {target.slot}".strip() if target.slot else key.replace("-", " "), state)

    def _set_timeline(self, value: int, last: int) -> None:
        self.timeline.props(f"max={max(last, 1)}")
        if not self.scrubbing:
            self.timeline.set_value(value)


def _target(name: str, state: str) -> None:
    """Show whether an object is where it should be, by a mark and in words."""
    there = state == THERE
    with ui.row().classes(f"run-target {'there' if there else ''}"):
        ui.icon("check_circle" if there else "radio_button_unchecked")
        ui.label(f"{name} {'in place' if there else state}")
