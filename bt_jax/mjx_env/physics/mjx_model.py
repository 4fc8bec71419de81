"""The MJX model of a task, and one step of a motion in it: collisions and constraints are MJX's, the solver is
`newton.solve`.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Bool, Float32, Int32

from bt_jax.mjx_env.physics._mjx import mjx
from bt_jax.mjx_env.physics.mjx_contacts import Contacts, without_edges
from bt_jax.mjx_env.physics.mjx_scene import stand_in_mjcf
from bt_jax.mjx_env.physics.newton import free_accelerations, solve
from bt_jax.mjx_env.physics.protocol import QUIET_STEPS
from bt_jax.mjx_env.scene.mjcf import ROCKING_TURN, resolve_ids, timing
from bt_jax.tasks import Task

__all__ = ["Model", "Motion", "model_of"]

ITERATIONS = 8
WARP_CONTACTS_PER_BOX = 24
ROWS_PER_CONTACT = 4  # edges of a friction pyramid
PARKED = 50.0  # metres above everything, and falling


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Motion:
    """A problem that is being simulated, or a batch of W."""

    kits: Float32[Array, "*W T 3"]
    start: Float32[Array, "*W B 7"]
    present: Bool[Array, "*W B"]
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


@functools.lru_cache(maxsize=16)
def model_of(task: Task, *, warp_lanes: int = 0) -> Model:
    """Return the model of a task, the same one for equal tasks."""
    with jax.ensure_compile_time_eval():  # its arrays outlive the trace in which they may be made
        return Model(task, warp_lanes)


class Model:
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

    def begin(self, kits: Float32[Array, "T 3"], start: Float32[Array, "B 7"], present: Bool[Array, " B"]) -> Motion:
        """Return the motion of one problem before its first step; it rests if nothing is present."""
        boxes = len(self.ids.objects)
        return Motion(
            kits=kits,
            start=start,
            present=present,
            poses=start,
            velocities=jnp.zeros((boxes, 6), jnp.float32),
            warmstart=jnp.zeros(6 * boxes, jnp.float32),
            steps=jnp.int32(0),
            quiet=jnp.where(jnp.any(present), jnp.int32(0), jnp.int32(QUIET_STEPS)),
            pace=jnp.float32(0),
            reach=jnp.zeros(boxes, jnp.float32),
            ok=jnp.bool_(True),
            anchor=start,
            wandered=jnp.float32(0),
        )

    def step(self, motion: Motion) -> Motion:
        """Do one physics step of one problem; boxes that are not present hang far above, each in its place."""
        present, here = motion.present, motion.present[:, None]
        poses = jnp.where(here, motion.poses, self.parked)
        data = self.data.replace(
            qpos=poses.ravel(),
            qvel=jnp.where(here, motion.velocities, jnp.float32(0)).ravel(),
            qacc_warmstart=motion.warmstart,
            mocap_pos=self._stand_in_positions(motion.kits, poses),
        )
        poses, velocities, warmstart = self._advance(data)
        sane = jnp.all(jnp.where(here, jnp.isfinite(poses), True)) & jnp.all(
            jnp.where(here, jnp.abs(poses[:, :3]) < self.scales.far, True)
        )
        linear = jnp.linalg.norm(velocities[:, :3], axis=-1) / jnp.float32(self.scales.speed)
        angular = jnp.linalg.norm(velocities[:, 3:], axis=-1) / jnp.float32(self.scales.spin)
        pace = jnp.max(jnp.where(present, jnp.maximum(linear, angular), jnp.float32(0)))
        slow = (pace < 1) & (pace < motion.pace + jnp.float32(0.01))
        offset = jnp.linalg.norm(poses[:, :2] - motion.start[:, :2], axis=-1)
        begins, ends = (steps % self.scales.window == 0 for steps in (motion.steps, motion.steps + 1))
        anchor = jnp.where(begins, poses, motion.anchor)
        away = jnp.abs(poses - anchor) / jnp.array([[self.scales.rocking] * 3 + [ROCKING_TURN] * 4], jnp.float32)
        wandered = jnp.maximum(jnp.where(begins, 0, motion.wandered), jnp.max(jnp.where(here, away, 0)))
        rocks = ends & (motion.steps >= self.scales.window) & (wandered < 1)
        return dataclasses.replace(
            motion,
            poses=jnp.where(sane, poses, motion.poses),
            velocities=velocities,
            warmstart=warmstart,
            steps=motion.steps + 1,
            quiet=jnp.where(rocks, QUIET_STEPS, jnp.where(slow, motion.quiet + 1, 0)),
            pace=pace,
            reach=jnp.where(sane, jnp.maximum(motion.reach, offset), motion.reach),
            ok=motion.ok & sane,
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
