"""What the browser builds the scene of a task from."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from bt_jax.app.state.snapping import catch_radius
from bt_jax.mjx_env.scene.mjcf import compile_scene
from bt_jax.mjx_env.surfaces import fixed_surfaces, surface_names
from bt_jax.tasks import Kit, Task
from bt_jax.tasks.slots import fits

__all__ = ["plain", "scene_model"]

VIEWS = {
    "home": (40, -10),
    "front": (8, 0),
    "side": (8, 90),
    "top": (89.9, 0),
}  # degrees above the horizon, to the right


@functools.lru_cache(maxsize=8)
def scene_model(task: Task) -> dict[str, Any]:
    """Return what the browser builds the scene from: the shapes of the compiled scene, the surfaces, and the view."""
    model, _ = compile_scene(task, gripper=True)
    surfaces = fixed_surfaces(task, np.zeros((1, len(task.kits), 3), np.float32))
    of = surface_names(task)
    tops = [
        {"name": name, "middle": [x, y], "x": x, "y": y, "half": half, "top": top}
        for name, (x, y), half, top in zip(
            of, surfaces.centre[0].tolist(), surfaces.half[0].tolist(), surfaces.top[0].tolist(), strict=True
        )
    ]
    low, high = _extent(task)
    return {
        "geoms": [_geom(model, i) for i in range(model.ngeom)],
        "objects": [
            {"name": thing.name, "shape": thing.shape, "size": thing.size, "color": thing.color}
            for thing in task.objects
        ],
        "kits": [
            _kit(task, kit, [top for name, top in zip(of, tops, strict=True) if name == kit.name]) for kit in task.kits
        ],
        "right": task.right[:2],
        "away": task.away[:2],
        "tables": tops[1 : 1 + len(task.tables)],
        "top": max(table.top for table in task.tables),
        "room": [(low - 0.1 * (high - low)).tolist(), (high + 0.1 * (high - low)).tolist()],
        "light": (np.array([0, 0, 2.2]) - 0.9 * np.array(task.right) - 0.8 * np.array(task.away)).tolist(),
        "floor": task.floor,
        "shown": [low.tolist(), high.tolist()],
        "views": {name: _view(task, *map(math.radians, angles)) for name, angles in VIEWS.items()},
    }


def _kit(task: Task, kit: Kit, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what is drawn of a kit besides its shapes: the surfaces to stand on, its slots, and from how far away [m] each
    slot catches an object."""
    slots = {slot.position: slot for slot in reversed(kit.places)}  # one that is written hides that of the grid there
    named = [
        {
            "name": slot.name,
            "position": [*position, kit.plate],
            "catches": {thing.name: catch_radius(kit, slot, thing) for thing in task.objects if fits(kit, slot, thing)},
        }
        for position, slot in slots.items()
    ]
    return {"name": kit.name, "half": [*kit.half, kit.thickness / 2], "parts": parts, "slots": named}


def _geom(model: mujoco.MjModel, index: int) -> dict[str, Any]:
    geom = model.geom(index)
    kinds = {mujoco.mjtGeom.mjGEOM_PLANE: "plane", mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder"}
    return {
        "body": model.body(int(geom.bodyid[0])).name,
        "type": kinds.get(int(geom.type[0]), "box"),
        "size": geom.size.tolist(),
        "pose": plain([*geom.pos, *geom.quat]),
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


def _view(task: Task, above: float, aside: float) -> list[float]:
    """Return the direction towards a person who faces the robot and looks down from these angles [rad] above the horizon and
    to the right."""
    level = math.sin(aside) * np.array(task.right) - math.cos(aside) * np.array(task.away)
    return plain(math.cos(above) * level + math.sin(above) * np.array([0.0, 0.0, 1.0]))


def plain(values: Sequence[float] | Float[np.ndarray, " N"]) -> list[float]:
    """Return numbers as they are sent to the browser."""
    return [round(float(value), 5) for value in values]
