"""MJX: all problems in one compiled loop, for accelerators and for use inside other compiled loops.

The loop has a fixed number of lanes; a lane whose problem is at rest takes the next. Collisions and constraints are
MJX's, the solver is `newton.solve`.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Bool, Float32, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics._mjx import mjx
from bt_jax.mjx_env.physics.mjx_contacts import Contacts, without_edges
from bt_jax.mjx_env.physics.mjx_scene import stand_in_mjcf
from bt_jax.mjx_env.physics.newton import free_accelerations, solve
from bt_jax.mjx_env.physics.protocol import QUIET_STEPS, Settled, SettleFn
from bt_jax.mjx_env.scene.mjcf import ROCKING_TURN, resolve_ids, timing
from bt_jax.tasks import Task

__all__ = ["MjxPhysics", "settle_fn"]

ITERATIONS = 8
WARP_CONTACTS_PER_BOX = 24
ROWS_PER_CONTACT = 4  # edges of a friction pyramid
Host = jax.Array | np.ndarray
PARKED = 50.0  # metres above everything, and falling


class MjxPhysics:
    """`Physics` by MJX; the arrays of the result are on JAX's default device. Batches are padded to powers of four, so
    that few shapes are compiled."""

    name = "mjx"
    description = "MJX, MuJoCo in JAX"

    def __init__(self, task: Task, *, implementation: str = "jax", lanes: int | None = None) -> None:
        self.task = task
        self._settle = functools.partial(_settle_kept, settle_fn(task, lanes=lanes, implementation=implementation))

    def settle(
        self, kits: Float32[Host, "S T 3"], poses: Float32[Host, "S B 7"], present: Bool[Host, "S B"]
    ) -> Settled:
        """See `Physics.settle`."""
        count = len(poses)
        bucket = _bucket(count)

        def pad(values, dtype):
            values = np.asarray(values, dtype)
            return np.concatenate([values, np.broadcast_to(values[:1], (bucket - count, *values.shape[1:]))])

        # Padding takes no part, so it is at rest as soon as the criterion allows.
        here = pad(present, bool)
        here[count:] = False
        result = self._settle(pad(kits, np.float32), pad(poses, np.float32), here)
        return jax.tree.map(lambda values: values[:count], result)


def _bucket(count: int) -> int:
    """Return the power of four that a batch is padded to; an accelerator solves a thousand problems as fast as a few."""
    smallest = 2 if jax.default_backend() == "cpu" else 5
    return 4 ** max(smallest, math.ceil(math.log(max(count, 1), 4)))


def settle_fn(task: Task, *, lanes: int | None = None, implementation: str = "jax") -> SettleFn:
    """Return the pure function `(kits, poses, present) -> Settled` of a task, to be jitted or used in jitted functions.

    `lanes` is how many problems are stepped at once (default: 64 on a CPU, 4096 elsewhere; never more than problems).
    Raises UserError if the implementation does not exist here.
    """
    if implementation not in ("jax", "warp"):
        raise UserError(f"MJX has no implementation '{implementation}'; use jax or warp")
    if implementation == "warp":
        _check_warp()
    lanes = lanes or (64 if jax.default_backend() == "cpu" else 4096)
    if implementation == "warp":  # its kernels are registered in the process that compiled them: nothing to keep
        return _warp_settle(_only_bodies(task), lanes)
    return _Settle(_only_bodies(task), lanes)


@dataclasses.dataclass(frozen=True)
class _Settle:
    """Names what its compiled form depends on, so that `kept_jit` can keep that."""

    task: Task
    lanes: int

    def __call__(self, kits: Array, poses: Array, present: Array) -> Settled:
        return _settle(_model(self.task), self.lanes, kits, poses, present)


@functools.lru_cache(maxsize=16)  # equal functions are compiled once
def _warp_settle(task: Task, lanes: int) -> SettleFn:
    return functools.partial(_settle, _model(task, warp_lanes=lanes), lanes)


def _only_bodies(task: Task) -> Task:
    """Return the task without what the simulation does not depend on, so that tasks with the same bodies share compiled
    code."""
    kits = tuple(dataclasses.replace(kit, slots=()) for kit in task.kits)
    blank = Task("", "", task.tables, kits, task.objects, targets=())
    return dataclasses.replace(blank, robot_position=task.robot_position)


@kept_jit(static_argnames=("settle",))
def _settle_kept(settle: SettleFn, kits: Array, poses: Array, present: Array) -> Settled:
    return settle(kits, poses, present)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Lane:
    """A problem that is being simulated."""

    problem: Int32[Array, "*W"]
    poses: Float32[Array, "*W B 7"]
    velocities: Float32[Array, "*W B 6"]
    warmstart: Float32[Array, "*W dofs"]
    steps: Int32[Array, "*W"]
    quiet: Int32[Array, "*W"]
    pace: Float32[Array, "*W"]
    reach: Float32[Array, "*W B"]
    ok: Bool[Array, "*W"]
    anchor: Float32[Array, "*W B 7"]  # the poses when a window began (see `Timing`)
    wandered: Float32[Array, "*W"]  # how far anything went since, 1 being too far to have only rocked


def _settle(
    model: _Model,
    lanes: int,
    kits: Float32[Array, "S T 3"],
    poses: Float32[Array, "S B 7"],
    present: Bool[Array, "S B"],
) -> Settled:
    problems, boxes = present.shape
    width = min(lanes, problems)
    empty = Settled(
        poses, jnp.ones(problems, bool), jnp.zeros(problems, jnp.int32), jnp.zeros((problems, boxes), jnp.float32)
    )

    def fresh(problem: Int32[Array, ""]) -> _Lane:
        return _Lane(
            problem=problem,
            poses=poses[problem],
            velocities=jnp.zeros((boxes, 6), jnp.float32),
            warmstart=jnp.zeros(6 * boxes, jnp.float32),
            steps=jnp.int32(0),
            quiet=jnp.int32(0),
            pace=jnp.float32(0),
            reach=jnp.zeros(boxes, jnp.float32),
            ok=jnp.bool_(True),
            anchor=poses[problem],
            wandered=jnp.float32(0),
        )

    def advance(lane: _Lane) -> _Lane:
        at = jnp.minimum(lane.problem, problems - 1)
        return model.step(lane, kits[at], poses[at], present[at])

    def body(carry):
        lane, taken, out = carry
        lane = jax.vmap(advance)(lane)
        done = (lane.quiet >= QUIET_STEPS) | (lane.steps >= model.scales.most_steps) | ~lane.ok
        where = jnp.where(done, lane.problem, problems)  # out of range: dropped
        found = Settled(lane.poses, lane.ok, lane.steps, lane.reach)
        out = jax.tree.map(lambda all_, new: all_.at[where].set(new, mode="drop"), out, found)
        order = jnp.cumsum(done.astype(jnp.int32)) - 1
        following = jnp.where(done, jnp.minimum(taken + order, problems), lane.problem)
        begun = jax.vmap(fresh)(following)
        lane = jax.tree.map(lambda new, old: jnp.where(_align(done, new), new, old), begun, lane)
        return lane, taken + done.sum(dtype=jnp.int32), out

    start = jax.vmap(fresh)(jnp.arange(width, dtype=jnp.int32))
    carry = jax.lax.while_loop(lambda c: jnp.any(c[0].problem < problems), body, (start, jnp.int32(width), empty))
    out = carry[2]
    gone = ~present
    return dataclasses.replace(
        out, poses=jnp.where(gone[..., None], poses, out.poses), reach=jnp.where(gone, jnp.float32(0), out.reach)
    )


def _align(mask, values):
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))


@functools.lru_cache(maxsize=16)
def _model(task: Task, *, warp_lanes: int = 0) -> _Model:
    with jax.ensure_compile_time_eval():  # its arrays outlive the trace in which they may be made
        return _Model(task, warp_lanes)


class _Model:
    """The MJX model of a task and one step of it: by Warp with room for `warp_lanes` problems, or if 0 by JAX."""

    def __init__(self, task: Task, warp_lanes: int) -> None:
        self.task = task
        self.scales = timing(task)
        implementation = "warp" if warp_lanes else "jax"
        xml, self.stand_ins = stand_in_mjcf(task)
        model = mujoco.MjModel.from_xml_string(xml)
        self.ids = resolve_ids(model, task)
        placed = mjx.put_model(model, impl=implementation)
        self.mjx = placed if warp_lanes else without_edges(placed)
        room = {}
        if warp_lanes:  # Warp stores the contacts of all lanes together, and drops those for which there is no room
            each = WARP_CONTACTS_PER_BOX * len(task.objects)
            room = {"naconmax": warp_lanes * each, "njmax": ROWS_PER_CONTACT * each}
        self.data = mjx.make_data(model, impl=implementation, **room)
        self.implementation = implementation
        inertia = [
            np.repeat([model.body_mass[body]], 3).tolist() + model.body_inertia[body].tolist()
            for body in self.ids.objects
        ]
        self.parked = np.zeros((len(task.objects), 7), np.float32)
        self.parked[:, 0] = 10 * max(thing.edge for thing in task.objects) * np.arange(len(task.objects))
        self.parked[:, 2:4] = PARKED, 1
        self.mass = np.array(inertia, np.float32)
        self.gravity = np.array(model.opt.gravity, np.float32)
        if not warp_lanes:
            self.contacts = Contacts(model, self.mjx, self.scales.size)

    def step(
        self, lane: _Lane, kits: Float32[Array, "T 3"], start: Float32[Array, "B 7"], present: Bool[Array, " B"]
    ) -> _Lane:
        """Do one physics step of one problem; boxes that are not present hang far above, each in its place."""
        here = present[:, None]
        poses = jnp.where(here, lane.poses, self.parked)
        data = self.data.replace(
            qpos=poses.ravel(),
            qvel=jnp.where(here, lane.velocities, jnp.float32(0)).ravel(),
            qacc_warmstart=lane.warmstart,
            mocap_pos=self._stand_in_positions(kits, poses),
        )
        poses, velocities, warmstart = self._advance(data)
        sane = jnp.all(jnp.where(here, jnp.isfinite(poses), True)) & jnp.all(
            jnp.where(here, jnp.abs(poses[:, :3]) < self.scales.far, True)
        )
        linear = jnp.linalg.norm(velocities[:, :3], axis=-1) / jnp.float32(self.scales.speed)
        angular = jnp.linalg.norm(velocities[:, 3:], axis=-1) / jnp.float32(self.scales.spin)
        pace = jnp.max(jnp.where(present, jnp.maximum(linear, angular), jnp.float32(0)))
        slow = (pace < 1) & (pace < lane.pace + jnp.float32(0.01))
        offset = jnp.linalg.norm(poses[:, :2] - start[:, :2], axis=-1)
        begins, ends = (steps % self.scales.window == 0 for steps in (lane.steps, lane.steps + 1))
        anchor = jnp.where(begins, poses, lane.anchor)
        away = jnp.abs(poses - anchor) / jnp.array([[self.scales.rocking] * 3 + [ROCKING_TURN] * 4], jnp.float32)
        wandered = jnp.maximum(jnp.where(begins, 0, lane.wandered), jnp.max(jnp.where(here, away, 0)))
        rocks = ends & (lane.steps >= self.scales.window) & (wandered < 1)
        return _Lane(
            problem=lane.problem,
            poses=jnp.where(sane, poses, lane.poses),
            velocities=velocities,
            warmstart=warmstart,
            steps=lane.steps + 1,
            quiet=jnp.where(rocks, QUIET_STEPS, jnp.where(slow, lane.quiet + 1, 0)),
            pace=pace,
            reach=jnp.where(sane, jnp.maximum(lane.reach, offset), lane.reach),
            ok=lane.ok & sane,
            anchor=anchor,
            wandered=wandered,
        )

    def _advance(self, data: mjx.Data) -> tuple[Float32[Array, "B 7"], Float32[Array, "B 6"], Float32[Array, " dofs"]]:
        """Do as `mjx.step` for objects without joints among them: same collisions and constraints, another solver."""
        boxes = len(self.ids.objects)
        # MJX promotes types and ranks freely; this package's tests do not.
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            if self.implementation == "warp":
                data = mjx.step(self.mjx, data)
                return data.qpos.reshape(boxes, 7), data.qvel.reshape(boxes, 6), data.qacc_warmstart
            with jax.named_scope("collision"):  # the scopes are for profiles
                data = mjx.collision(self.mjx, mjx.com_pos(self.mjx, mjx.kinematics(self.mjx, data)))
                data = data.tree_replace({"_impl.contact": self.contacts.as_in_c(data)})
            with jax.named_scope("constraints"):
                data = mjx.make_constraint(self.mjx, mjx.factor_m(self.mjx, mjx.crb(self.mjx, data)))
        rows = data._impl
        with jax.named_scope("solver"):
            acceleration = solve(
                jnp.asarray(self.mass.ravel()),
                free_accelerations(
                    jnp.asarray(self.mass), jnp.asarray(self.gravity), data.qvel.reshape(boxes, 6)
                ).ravel(),
                rows.efc_J,
                rows.efc_D,
                rows.efc_aref,
                data.qacc_warmstart,
                iterations=ITERATIONS,
            )
        step = jnp.float32(self.scales.step)
        velocities = (data.qvel + step * acceleration).reshape(boxes, 6)
        poses = data.qpos.reshape(boxes, 7)
        turned = jax.vmap(_turn)(poses[:, 3:], velocities[:, 3:] * step)
        return jnp.concatenate([poses[:, :3] + step * velocities[:, :3], turned], axis=1), velocities, acceleration

    def _stand_in_positions(
        self, kits: Float32[Array, "T 3"], poses: Float32[Array, "B 7"]
    ) -> Float32[Array, "mocap 3"]:
        """Return where the kits and each stand-in is, in the order of the mocap bodies."""
        rows = list(kits)
        for box, choices, kit in self.stand_ins:
            places = jnp.asarray(choices, jnp.float32) + (jnp.zeros_like(kits[0]) if kit is None else kits[kit])[None]
            away = jnp.sum((places[:, :2] - poses[box, :2][None]) ** 2, axis=-1)
            rows.append(places[jnp.argmin(away)])
        return jnp.stack(rows)


def _turn(quat: Float32[Array, "4"], turn: Float32[Array, "3"]) -> Float32[Array, "4"]:
    """Return a quaternion (wxyz) turned by a rotation vector [rad] in its own frame."""
    angle = jnp.sqrt(jnp.sum(turn**2) + jnp.float32(1e-20))
    half = 0.5 * angle
    w, xyz = jnp.cos(half), turn * (jnp.sin(half) / angle)
    vector = quat[0] * xyz + w * quat[1:] + jnp.cross(quat[1:], xyz)
    result = jnp.concatenate([(quat[0] * w - jnp.dot(quat[1:], xyz))[None], vector])
    return result / jnp.linalg.norm(result)


def _check_warp() -> None:
    try:
        importlib.import_module("warp")
    except ImportError:
        raise UserError('implementation "warp" needs the package warp-lang; install bt_jax[cuda], or use jax') from None
    if jax.default_backend() != "gpu":
        raise UserError('implementation "warp" needs an NVIDIA GPU that JAX can see; use jax')
