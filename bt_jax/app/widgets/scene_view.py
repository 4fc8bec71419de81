"""The scene in 3D, at the left of every window: it shows the state of the studio, and a person can drag what is in it."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import mujoco
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
from bt_jax.behaviors import Behavior, Vocabulary
from bt_jax.mjx_env.render.choreography import Shot, Stage
from bt_jax.mjx_env.scene.mjcf import compile_scene
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.surfaces import fixed_surfaces, surface_names
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Kit, Task

__all__ = ["Dragging", "Ghost", "SceneView"]

THREE = Path(nicegui.__file__).parent / "elements" / "scene" / "dist"  # NiceGUI's copy of three.js, a private folder
PARTS = Path(__file__).parents[1] / "static" / "scene"
PITCH, TURN = math.radians(42), math.radians(-8)  # of the view at the beginning, below the horizon and about z
Dragging = Literal["", "objects", "targets"]
Pose = Sequence[float] | Float[np.ndarray, "7"]


@dataclasses.dataclass(frozen=True, eq=False)
class Ghost:
    """A translucent copy of the object `name` at a pose [m, world; wxyz], with a text to show on hover."""

    name: str
    pose: Pose
    text: str


class SceneView(Element, component="../static/scene.js", esm={"nicegui-scene": str(THREE), "bt_jax-scene": str(PARTS)}):
    """Tables, kits, objects and gripper, and translucent copies of objects where they should be.

    What is shown depends on the step of the window: where things start, what the player does, or what teaching shows. An
    object that was dropped or clicked is reported to whoever has asked for it with `on_drop` and `on_pick`.
    """

    def __init__(self, studio: Studio, page: PageContext) -> None:
        super().__init__()
        self.studio, self.page = studio, page
        self._props["label"] = (
            "The scene, which the list after it describes; drag or press the arrow keys to turn the view, plus and minus to "
            "zoom, double-click to reset it"
        )
        self.props("data-testid=scene")
        self._arranging: Dragging = "targets"
        self._ready = False
        self._cue: Cue | None = None
        self._ghosts: dict[str, list[dict[str, Any]]] = {}
        self._on_drop: list[Callable[[Dragging, str, np.ndarray], Any]] = []
        self._on_pick: list[Callable[[str], Any]] = []
        self.on("ready", self._begin)
        self.on("drop", page.guard(self._drop))
        self.on("pick", page.guard(self._pick))
        page.on("task", self._rebuild)
        page.on("scene", self._show, now=False)
        page.on("player", self._follow, now=False)
        page.on_step(lambda step: self._enter())

    def on_drop(self, callback: Callable[[Dragging, str, np.ndarray], Any]) -> None:
        """Call back with what was dragged (objects or targets), its name or key, and where its centre was dropped [m,
        world]."""
        self._on_drop.append(callback)

    def on_pick(self, callback: Callable[[str], Any]) -> None:
        """Call back with the name of an object that was clicked."""
        self._on_pick.append(callback)

    def arrange(self, dragging: Dragging) -> None:
        """Set what a person may drag in the step `task`: objects or targets."""
        self._arranging = dragging
        self._enter()

    def ghost(self, copies: Mapping[str, Ghost], *, group: str) -> None:
        """Show translucent copies of objects by their keys, in place of those that `group` had before."""
        ghosts = [
            {"key": key, "name": one.name, "pose": _plain(one.pose), "text": one.text} for key, one in copies.items()
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
        model = _model(self.studio.edited.task)
        if model != self._props.get("model"):
            self._ready, self._ghosts = False, {}
            self._props["model"] = model
            self.update()
        self._show_targets()

    def _begin(self) -> None:
        """Send what the browser needs once it has built the scene of the task."""
        self._ready = True
        self._call("setDragging", self._dragging)
        self._show(glide=False)
        for group, ghosts in self._ghosts.items():
            self._call("setGhosts", group, ghosts)

    def _enter(self) -> None:
        self._call("setDragging", self._dragging)
        self._show()

    @property
    def _dragging(self) -> Dragging:
        return {"task": self._arranging, "run": "objects"}.get(self.page.step, "")

    def _show(self, *, glide: bool = True) -> None:
        world, playing = self.world, self.studio.playing
        if self.page.step == "run" and playing.player is not None:
            shot, self._cue = playing.player.now.shots[-1], playing.cue
        else:
            shot, self._cue = _at_rest(self.studio.edited.task, world), None
        kits = [[*_plain(origin), 1, 0, 0, 0] for origin in np.asarray(world.kits)[0]]
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
            "objects": [_plain(pose) for pose in shot.poses],
            "gripper": _plain([*gripper.position, gripper.opening, gripper.yaw]),
            "base": None if shot.base is None else _plain([*shot.base, self.studio.edited.task.floor]),
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

    async def _pick(self, event: GenericEventArguments) -> None:
        for callback in self._on_pick:
            await _finished(callback(event.args))


async def _finished(result: Any) -> None:
    if inspect.isawaitable(result):
        await result


@functools.lru_cache(maxsize=8)
def _model(task: Task) -> dict[str, Any]:
    """Return what the browser builds the scene from: the shapes of the compiled scene, the surfaces, and the view."""
    model, _ = compile_scene(task, gripper=True)
    surfaces = fixed_surfaces(task, np.zeros((1, len(task.kits), 3), np.float32))
    tops = [
        {"x": x, "y": y, "half": half, "top": top}
        for (x, y), half, top in zip(
            surfaces.centre[0].tolist(), surfaces.half[0].tolist(), surfaces.top[0].tolist(), strict=True
        )
    ]
    of = surface_names(task)
    low, high = _extent(task)
    return {
        "geoms": [_geom(model, i) for i in range(model.ngeom)],
        "objects": [
            {"name": thing.name, "shape": thing.shape, "size": thing.size, "color": thing.color}
            for thing in task.objects
        ],
        "kits": [_kit(kit, [top for name, top in zip(of, tops, strict=True) if name == kit.name]) for kit in task.kits],
        "tables": tops[1 : 1 + len(task.tables)],
        "top": max(table.top for table in task.tables),
        "room": [(low - 0.1 * (high - low)).tolist(), (high + 0.1 * (high - low)).tolist()],
        "light": (np.array([0, 0, 3.0]) - 1.2 * np.array(task.right) - 0.9 * np.array(task.away)).tolist(),
        "camera": _camera(task),
    }


def _kit(kit: Kit, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what is drawn of a kit besides its shapes: the surfaces to stand on, and the names of its slots."""
    slots = {
        slot.position: slot.name for slot in reversed(kit.places)
    }  # one that is written hides that of the grid there
    named = [{"name": name, "position": [*position, kit.plate]} for position, name in slots.items()]
    return {"name": kit.name, "parts": parts, "slots": named}


def _geom(model: mujoco.MjModel, index: int) -> dict[str, Any]:
    geom = model.geom(index)
    kinds = {mujoco.mjtGeom.mjGEOM_PLANE: "plane", mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder"}
    return {
        "body": model.body(int(geom.bodyid[0])).name,
        "type": kinds.get(int(geom.type[0]), "box"),
        "size": geom.size.tolist(),
        "pose": _plain([*geom.pos, *geom.quat]),
        "color": model.mat_rgba[int(geom.matid[0]), :3].tolist(),
    }


def _extent(task: Task) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the lowest and highest corner of what is in view [m]: the upper part of the tables, and a stack on them."""
    middles, halves = (np.array([getattr(t, key) for t in task.tables]) for key in ("position", "size"))
    low, high = (middles - halves / 2).min(axis=0), (middles + halves / 2).max(axis=0)
    unit = max(thing.height for thing in task.objects)
    low[2] = max(low[2], high[2] - 2.5 * unit)
    high[2] += 4 * unit
    return low, high


def _camera(task: Task) -> dict[str, Any]:
    """Return the view of a person who faces the robot, from above and a little from the side; `across` and `upright` are the
    tangents of half the angles of view that show everything."""
    low, high = _extent(task)
    right, away, up = np.array(task.right), np.array(task.away), np.array([0.0, 0.0, 1.0])
    level = math.cos(TURN) * away - math.sin(TURN) * right
    view = math.cos(PITCH) * level - math.sin(PITCH) * up
    target, distance = (low + high) / 2, 2.2 * float(np.linalg.norm(high - low))
    eye = target - distance * view
    side = np.cross(view, up) / np.linalg.norm(np.cross(view, up))
    corners = np.array(list(itertools.product(*zip(low, high, strict=True)))) - eye
    depth = corners @ view
    return {
        "eye": eye.tolist(),
        "target": target.tolist(),
        "across": float(np.abs(corners @ side / depth).max()),
        "upright": float(np.abs(corners @ np.cross(side, view) / depth).max()),
    }


def _at_rest(task: Task, world: World) -> Shot:
    """Return the scene between two motions."""
    semantics = LeafSemantics(task, Vocabulary.of([Behavior("open_gripper")]))
    return Stage(semantics, world, fps=1.0).shots[-1]


def _plain(values: Pose) -> list[float]:
    return [round(float(value), 5) for value in values]
