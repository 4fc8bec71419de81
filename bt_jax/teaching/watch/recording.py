"""A watched demonstration in the form that is learnt from: picks and places with the pose of an end effector, upright over
what was moved, in every frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.planning.pose_geometry import level
from bt_jax.lfd import Action, Demonstration, Frames, Pose
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT
from bt_jax.lfd.demonstration import Kind as ActionKind
from bt_jax.tasks import Task
from bt_jax.teaching.watch.moves import Decision, Watched
from bt_jax.teaching.watch.rest import Rest

__all__ = ["demonstration_of"]


def demonstration_of(watched: Watched, decisions: Sequence[Decision], task: Task) -> Demonstration:
    """Return what was shown, with one decision for each doubt. Frames of boxes are level: z points up, whichever face a box
    lies on.

    Raise UserError if it is to be shown again or left out, or if nothing of it is left.
    """
    for doubt, decision in zip(watched.doubts, decisions, strict=True):
        if decision == "again" or (doubt.kind == "lost" and decision == "leave out"):
            raise UserError(f"{doubt.text}; show it again")
    if not watched.start:
        raise UserError("the boxes and the kit were never seen at rest together; show all of them before you begin")
    scene, actions = dict(watched.start), []
    counted = _counted(watched, decisions, task)
    for index, move in enumerate(watched.moves):
        if index in counted:
            actions.append(_action("pick", move.box, scene, task))
        scene[move.box] = move.after
        if index in counted:
            actions.append(_action("place", move.box, scene, task))
    if not actions:
        raise UserError("nothing was moved; take a box and put it elsewhere")
    return Demonstration("demo", tuple(actions))


def _counted(watched: Watched, decisions: Sequence[Decision], task: Task) -> set[int]:
    """Return the moves that are actions; the kit's never is."""
    counted = {index for index, move in enumerate(watched.moves) if move.kind == "carried"}
    for doubt, decision in zip(watched.doubts, decisions, strict=True):
        if doubt.kind == "bumped" and decision == "keep":
            counted |= {index for index in doubt.moves if watched.moves[index].box in task.object_names}
        elif doubt.kind == "twice" and decision == "leave out":
            counted.discard(doubt.moves[0])
        elif doubt.kind == "together" and decision == "leave out":
            counted -= set(doubt.moves)
    return counted


def _action(kind: ActionKind, box: str, scene: Mapping[str, Rest], task: Task) -> Action:
    centre = scene[box].pose.translation
    effector = RigidTransform.from_translation([*centre[:2], centre[2] + END_EFFECTOR_HEIGHT])
    poses, sigmas = {}, {}
    for frame in Frames.of(task).names:
        if frame == task.robot_frame:
            poses[frame], sigmas[frame] = _pose(effector), scene[box].sigma
            continue
        own = scene[frame]
        place = own.pose if frame in task.kit_names else level(own.pose)
        poses[frame] = _pose(place.inv() * effector)
        sigmas[frame] = scene[box].sigma if frame == box else math.hypot(scene[box].sigma, own.sigma)
    return Action(kind, poses, sigmas)


def _pose(found: RigidTransform) -> Pose:
    x, y, z = map(float, found.translation)
    a, b, c, d = map(float, found.rotation.as_quat(canonical=True, scalar_first=True))
    return Pose((x, y, z), (a, b, c, d))
