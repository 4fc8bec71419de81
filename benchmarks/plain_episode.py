"""The alternative a user would pick: py_trees ticking one tree at a time against one MuJoCo scene."""

from __future__ import annotations

import math

import jax
import mujoco
import numpy as np
from py_trees.common import Status as PyStatus

from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.fitness import fitness
from bt_jax.mjx_env.episodes.rules import Ending, count_tick, fresh_tally
from bt_jax.mjx_env.faults.fates import Fates, drawn
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.scene.mjcf import compile_scene, timing
from bt_jax.mjx_env.skills import LIFT, Mishaps
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["FaultyEpisode", "PlainEpisode", "mishaps_of"]

QUIET, MAX_STEPS = 4, 400


class PlainEpisode:
    """Runs trees in one scene, every behavior a call on the simulation; counts physics steps."""

    def __init__(self, task: Task) -> None:
        if task.subgoals:
            raise ValueError(f"task {task.name} has subgoals, which are not followed here")
        self.task = task
        self.model, _ = compile_scene(task, task.object_names)
        self.data = mujoco.MjData(self.model)
        self.scales = timing(task)
        self.sizes = {box.name: box.edge for box in task.objects}
        self.steps = 0

    def run(self, tree: Tree, layout: World) -> float:
        """Fitness of one episode in a layout (one state, NumPy)."""
        mujoco.mj_resetData(self.model, self.data)
        self.kit = np.array(layout.kits[0], float)
        self.data.mocap_pos[0] = self.kit
        self.data.qpos[:] = layout.poses.reshape(-1)
        self.held, self.gripper_open = None, True
        root = to_py_trees(tree, self.status, expand_genes=True)
        tally, command, broken = fresh_tally(1), np.zeros(1, np.int32), np.zeros(1, bool)
        while tally.ending[0] == Ending.OPEN:
            self.pending, self.tick = None, int(tally.ticks[0])
            root.tick_once()
            if self.pending is not None:
                self.act(self.pending)
            status = np.array([Status[root.status.name]], np.int8)
            tally = count_tick(tally, status, command, broken, self.task.episode)
        distance = sum(
            np.linalg.norm(self.position(t.object) - self.in_world(t.frame, t.position)) for t in self.task.targets
        )
        return float(
            fitness(
                self.task,
                distance=np.float32(distance),
                subgoals_missed=np.int32(0),
                nodes=np.int32(len(prefix(tree))),
                ending=tally.ending[0],
            )
        )

    def status(self, leaf: Behavior) -> PyStatus:
        """What a leaf returns now; an action that runs is remembered and carried out after the tick."""
        if leaf.name == "pick":
            done, possible = self.held == leaf.object, self.gripper_open and self.can_pick(leaf.object)
        elif leaf.name == "place":
            done, possible = self.at(leaf) and self.held is None, self.held == leaf.object
        elif leaf.name == "open_gripper":
            done, possible = self.gripper_open and self.held is None, True
        elif leaf.name == "close_gripper":
            done, possible = not self.gripper_open, True
        else:
            return PyStatus.SUCCESS if self.holds(leaf) else PyStatus.FAILURE
        if done:
            return PyStatus.SUCCESS
        if not possible:
            return PyStatus.FAILURE
        self.pending = leaf
        return PyStatus.RUNNING

    def holds(self, leaf: Behavior) -> bool:
        if leaf.name == "at":
            return self.at(leaf)
        if leaf.name == "gripper":
            return self.gripper_open == (leaf.args[0] == "open")
        return (self.held or "nothing") == leaf.args[0]

    def at(self, leaf: Behavior) -> bool:
        return self.is_near(leaf) and self.held != leaf.object

    def is_near(self, leaf: Behavior) -> bool:
        goal = self.in_world(leaf.frame, leaf.position)
        return bool(np.linalg.norm(self.position(leaf.object) - goal) < self.task.episode.tolerance)

    def can_pick(self, name: str) -> bool:
        low = self.position(name)[2] < min(table.top for table in self.task.tables) - 0.1 * self.sizes[name]
        return bool(not low) and self.is_clear(name)

    def is_clear(self, name: str) -> bool:
        position, size = self.position(name), self.sizes[name]
        for other in self.task.object_names:
            offset = self.position(other) - position
            if other != name and abs(offset[:2]).max() < size and 0.6 * size < offset[2] < 1.3 * size:
                return False
        return True

    def act(self, action: Behavior) -> None:
        """Moves the gripper, then lets the scene come to rest."""
        if action.name == "pick":
            self.held, self.gripper_open = action.object, False
            self.body_qpos(action.object)[2] += LIFT * self.sizes[action.object]
        elif action.name == "place":
            self.body_qpos(action.object)[:3] = self.release_position(action)
            self.held, self.gripper_open = None, True
        else:
            self.held, self.gripper_open = None, action.name == "open_gripper"
        self.settle()

    def release_position(self, action: Behavior) -> np.ndarray:
        """Where the gripper lets go: the goal, or over what is in the way of lowering the box there."""
        goal = self.in_world(action.frame, action.position)
        goal[2] = max(goal[2], self.highest_under(action.object, goal) + self.sizes[action.object] / 2)
        return goal

    def settle(self) -> None:
        """Steps until nothing has moved for some steps; the held box stays where the gripper holds it."""
        self.data.qvel[:] = 0
        held = None if self.held is None else self.body_qpos(self.held).copy()
        quiet = 0
        for _ in range(MAX_STEPS):
            mujoco.mj_step(self.model, self.data)
            self.steps += 1
            if held is not None:
                self.body_qpos(self.held)[:] = held
                self.body_qvel(self.held)[:] = 0
            velocity = self.data.qvel.reshape(-1, 6)
            slow = (np.linalg.norm(velocity[:, :3], axis=1) < self.scales.speed).all()
            slow = slow and (np.linalg.norm(velocity[:, 3:], axis=1) < self.scales.spin).all()
            quiet = quiet + 1 if slow else 0
            if quiet >= QUIET:
                return

    def position(self, name: str) -> np.ndarray:
        return self.body_qpos(name)[:3]

    def body_qpos(self, name: str) -> np.ndarray:
        i = self.task.object_names.index(name)
        return self.data.qpos[7 * i : 7 * i + 7]

    def body_qvel(self, name: str) -> np.ndarray:
        i = self.task.object_names.index(name)
        return self.data.qvel[6 * i : 6 * i + 6]

    def in_world(self, frame: str, position: tuple[float, float, float]) -> np.ndarray:
        if frame == self.task.kits[0].name:
            return self.kit + position
        if frame == self.task.robot_frame:
            return np.array(self.task.robot_position) + position
        rotated = np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, np.array(position, float), self.body_qpos(frame)[3:])
        return self.position(frame) + rotated

    def highest_under(self, name: str, goal: np.ndarray) -> float:
        """Top of whatever lies under a box of that size at `goal`."""
        half = 0.48 * self.sizes[name]
        tops = [0.0]
        for table in self.task.tables:
            if (abs(goal[:2] - table.position[:2]) < half + np.array(table.size[:2]) / 2).all():
                tops.append(table.top)
        kit = self.task.kits[0]
        offset = abs(goal[:2] - self.kit[:2])
        if (offset < half + kit.size[0] / 2).all():
            on_wall = (offset + half > kit.size[0] / 2 - kit.wall_thickness).any()
            tops.append(self.kit[2] + kit.thickness / 2 + (kit.wall_height if on_wall else 0))
        for other in self.task.object_names:
            if other != name and (abs(goal[:2] - self.position(other)[:2]) < half + self.sizes[other] / 2).all():
                tops.append(self.position(other)[2] + self.sizes[other] / 2)
        return max(tops)


class FaultyEpisode(PlainEpisode):
    """Commands go wrong: they slip, jam or miss, as `mishaps` [ticks, classes] say (see `mishaps_of`)."""

    def __init__(self, task: Task, classes: dict[tuple[str, str], int]) -> None:
        super().__init__(task)
        self.classes = classes
        self.mishaps: Mishaps

    def act(self, action: Behavior) -> None:
        of_class = self.classes[action.name, action.object if action.name in ("pick", "place") else ""]
        if self.mishaps.jams[self.tick, of_class]:
            self.settle()
        elif self.mishaps.slips[self.tick, of_class]:
            self.gripper_open = False
            self.settle()
        else:
            self.error = self.mishaps.error[self.tick, of_class]
            super().act(action)

    def release_position(self, action: Behavior) -> np.ndarray:
        x, y, turn = self.error
        quat = self.body_qpos(action.object)[3:]
        mujoco.mju_mulQuat(quat, np.array([math.cos(turn / 2), 0, 0, math.sin(turn / 2)]), quat.copy())
        goal = self.in_world(action.frame, action.position) + np.array([x, y, 0])
        goal[2] = max(goal[2], self.highest_under(action.object, goal) + self.sizes[action.object] / 2)
        return goal


def mishaps_of(variants: Variants, fates: Fates) -> tuple[dict[tuple[str, str], int], Mishaps]:
    """The class of each action, given by its name and its object, and what goes wrong with it [episodes, ticks, classes]."""
    commands = variants.semantics.commands
    classes = {
        (command.name, command.object if command.args else ""): of_class
        for command, of_class in zip(commands, variants.classes.tolist(), strict=True)
    }
    episodes, ticks, _ = fates.variant.shape
    first = [list(variants.classes).index(of_class) for of_class in range(max(classes.values()) + 1)]
    shape = (episodes, ticks, len(first))
    command = np.broadcast_to(np.array(first, np.int32), shape)
    tick = np.broadcast_to(np.arange(ticks, dtype=np.int32)[:, None], shape)
    own = fates[np.repeat(np.arange(episodes), ticks * len(first))]
    variant, unit = drawn(own, variants, tick.ravel(), command.ravel())
    found = variants.mishaps(command.ravel(), variant, unit)
    return classes, jax.tree.map(lambda leaf: leaf.reshape(*shape, *leaf.shape[1:]), found)
