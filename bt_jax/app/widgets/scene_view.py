"""The scene in 3D, at the left of every window: it shows the state of the studio, and a person can drag what is in it."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import nicegui
import numpy as np
from jaxtyping import Float
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from bt_jax.app.plain_words import Words
from bt_jax.app.state.goals import goals
from bt_jax.app.state.playing import Cue
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.scene_model import plain, scene_model
from bt_jax.behaviors import Behavior, Vocabulary
from bt_jax.mjx_env.render.choreography import Shot, Stage
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["Dragging", "Ghost", "SceneView"]

THREE = Path(nicegui.__file__).parent / "elements" / "scene" / "dist"  # NiceGUI's copy of three.js, a private folder
PARTS = Path(__file__).parents[1] / "static" / "scene"
Dragging = Literal["", "objects", "targets", "things", "hand"]
Pose = Sequence[float] | Float[np.ndarray, "7"]


@dataclasses.dataclass(frozen=True, eq=False)
class Ghost:
    """A translucent copy of the object `name` at a pose [m, world; wxyz], with a text to show on hover; one that is `odd`
    stands out."""

    name: str
    pose: Pose
    text: str
    odd: bool = False


class SceneView(Element, component="../static/scene.js", esm={"nicegui-scene": str(THREE), "bt_jax-scene": str(PARTS)}):
    """Tables, kits, objects and gripper, and translucent copies of objects where they should be.

    What is shown depends on the step of the window: where things start, what the player does, or what teaching shows. An
    object that was dropped or clicked is reported to whoever has asked for it with `on_drop` and `on_pick`, one that the
    hand has carried in a demonstration with `on_carry`. `quarter` is by how many quarters a person has turned the view,
    counter-clockwise as seen from above.
    """

    def __init__(self, studio: Studio, page: PageContext) -> None:
        super().__init__()
        self.studio, self.page = studio, page
        self._props["label"] = (
            "The scene, which the list after it describes; drag or press the arrow keys to turn the view, plus and minus to "
            "zoom, double-click to reset it"
        )
        self.props("data-testid=scene")
        self.quarter = 0
        self._arranging: Dragging = "targets"
        self._dragged: Dragging = ""  # what the browser lets a person drag
        self._ready = False
        self._cue: Cue | None = None
        self._ghosts: dict[str, list[dict[str, Any]]] = {}
        self._on_drop: list[Callable[[Dragging, str, np.ndarray], Any]] = []
        self._on_carry: list[Callable[[str, np.ndarray, float], Any]] = []
        self._on_pick: list[Callable[[str], Any]] = []
        self._on_point: list[Callable[[str, np.ndarray], Any]] = []
        self.on("ready", self._begin)
        self.on("drop", page.guard(self._drop))
        self.on("carry", page.guard(self._carry))
        self.on("pick", page.guard(self._pick))
        self.on("quarter", self._turn)
        self.on("point", page.guard(self._point))
        page.on("task", self._rebuild)
        page.on("scene", self._show, now=False)
        page.on("player", self._follow, now=False)
        page.on("demonstrations", self._let_drag, now=False)
        page.on_step(lambda step: self._enter())

    def on_drop(self, callback: Callable[[Dragging, str, np.ndarray], Any]) -> None:
        """Call back with what was dragged (objects, targets, or things: objects and kits), its name or key, and where its
        centre was dropped [m, world]; an object that was dragged as a target without having one has its own name."""
        self._on_drop.append(callback)

    def on_carry(self, callback: Callable[[str, np.ndarray, float], Any]) -> None:
        """Call back with the name of an object that was carried by hand, where its centre was dropped [m, world], and by how
        many degrees it was turned on the way, counter-clockwise as seen from above."""
        self._on_carry.append(callback)

    def on_pick(self, callback: Callable[[str], Any]) -> None:
        """Call back with the name of an object that was clicked."""
        self._on_pick.append(callback)

    def on_point(self, callback: Callable[[str, np.ndarray], Any]) -> None:
        """Call back with the name of an object or a kit that was clicked, and where [m, world]; only while both can be
        dragged."""
        self._on_point.append(callback)

    def arrange(self, dragging: Dragging) -> None:
        """Set what a person may drag in the step `task`: objects, targets, or objects and kits."""
        self._arranging = dragging
        self._enter()

    def ghost(self, copies: Mapping[str, Ghost], *, group: str) -> None:
        """Show translucent copies of objects by their keys, in place of those that `group` had before."""
        ghosts = [
            {"key": key, "name": one.name, "pose": plain(one.pose), "text": one.text, "odd": one.odd}
            for key, one in copies.items()
        ]
        if ghosts != self._ghosts.get(group, []):
            self._ghosts[group] = ghosts
            self._call("setGhosts", group, ghosts)

    @property
    def world(self) -> World:
        """The state that this step of the window shows."""
        studio = self.studio
        if self.page.step in ("task", "evolve"):
            return studio.edited.start
        if self.page.step == "run":
            player = studio.playing.player
            return studio.edited.start if player is None else player.world
        return studio.teaching.shown

    @property
    def shows_targets(self) -> bool:
        """Whether this step of the window shows where objects should be."""
        return self.page.step in ("task", "evolve", "combine", "run")

    def _rebuild(self) -> None:
        model = scene_model(self.studio.edited.task)
        if model != self._props.get("model"):
            self._ready, self._ghosts = False, {}
            self._props["model"] = model
            self.update()
        self._show_targets()

    def _begin(self) -> None:
        """Send what the browser needs once it has built the scene of the task."""
        self._ready, self._dragged = True, ""
        self._let_drag()
        self._show(glide=False)
        for group, ghosts in self._ghosts.items():
            self._call("setGhosts", group, ghosts)

    def _enter(self) -> None:
        self._let_drag()
        self._show()

    def _let_drag(self) -> None:
        """Let a person drag what may be dragged now; what is being dragged returns if that has changed."""
        if self._ready and self._dragging != self._dragged:
            self._dragged = self._dragging
            self._call("setDragging", self._dragged)

    def _turn(self, event: GenericEventArguments) -> None:
        self.quarter = int(event.args) % 4

    @property
    def _dragging(self) -> Dragging:
        if self.page.step == "demonstrate" and self.studio.teaching.session is not None:
            return "hand"
        return {"task": self._arranging, "run": "objects"}.get(self.page.step, "")

    def _show(self, *, glide: bool = True) -> None:
        world, playing = self.world, self.studio.playing
        if self.page.step == "run" and playing.player is not None:
            shot, self._cue = playing.player.now.shots[-1], playing.cue
        else:
            shot, self._cue = _at_rest(self.studio.edited.task, world), None
        kits = [[*plain(origin), 1, 0, 0, 0] for origin in np.asarray(world.kits)[0]]
        self._call("show", {**self._state(shot), "kits": kits}, glide)
        self._show_targets()

    def _show_targets(self) -> None:
        task = self.studio.edited.task
        found, words = goals(task, self.world) if self.shows_targets else {}, Words(task)
        copies = {
            key: Ghost(
                goal.thing, goal.pose, f"{words.named(goal.target.object)} should be {words.target(goal.target)}"
            )
            for key, goal in found.items()
        }
        self.ghost(copies, group="targets")

    def _follow(self) -> None:
        """Play what the player does."""
        cue = self.studio.playing.cue
        if self.page.step != "run" or cue is self._cue:
            return
        if cue is None or cue.kind == "show" or self.studio.playing.player is None:
            self._show()
            return
        self._cue = cue
        if cue.kind == "play":
            self._call("play", [self._state(shot) for shot in cue.shots], 1000 * cue.seconds)
            self._show_targets()
        else:
            self._call("freeze", cue.kind == "freeze")

    def _state(self, shot: Shot) -> dict[str, Any]:
        """Return what the browser shows of one moment."""
        gripper = shot.gripper
        return {
            "objects": [plain(pose) for pose in shot.poses],
            "gripper": plain([*gripper.position, gripper.opening, gripper.yaw]),
            "base": None if shot.base is None else plain([*shot.base, self.studio.edited.task.floor]),
        }

    def _call(self, method: str, *arguments: Any) -> None:
        if self._ready:
            self.run_method(method, *arguments)

    async def _drop(self, event: GenericEventArguments) -> None:
        """Report a drop; the object stays there only if a callback has put it there."""
        dragged, name = event.args["kind"], event.args["name"]
        position = np.array(event.args["position"], float)
        try:
            for callback in self._on_drop:
                await _finished(callback(dragged, name, position))
        finally:
            self._call("drop")
            self._call("setGhosts", "targets", self._ghosts.get("targets", []))

    async def _carry(self, event: GenericEventArguments) -> None:
        """Report what the hand has carried; it stays there only if a callback has put it there."""
        name, position, turn = (event.args[key] for key in ("name", "position", "turn"))
        try:
            for callback in self._on_carry:
                await _finished(callback(name, np.array(position, float), float(turn)))
        finally:
            self._call("drop")

    async def _pick(self, event: GenericEventArguments) -> None:
        for callback in self._on_pick:
            await _finished(callback(event.args))

    async def _point(self, event: GenericEventArguments) -> None:
        for callback in self._on_point:
            await _finished(callback(event.args["name"], np.array(event.args["position"], float)))


async def _finished(result: Any) -> None:
    if inspect.isawaitable(result):
        await result


def _at_rest(task: Task, world: World) -> Shot:
    """Return the scene between two motions."""
    semantics = LeafSemantics(task, Vocabulary.of([Behavior("open_gripper")]))
    return Stage(semantics, world, fps=1.0).shots[-1]
