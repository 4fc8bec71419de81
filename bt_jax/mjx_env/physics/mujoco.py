"""The C engine on a pool of threads: many small problems, each with a model of only the objects that take part."""

from __future__ import annotations

import os
from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int
from mujoco.rollout import Rollout

from bt_jax.mjx_env.physics.protocol import QUIET_STEPS, Settled
from bt_jax.mjx_env.scene.mjcf import ROCKING_TURN, compile_scene, timing
from bt_jax.mjx_env.world import row_names
from bt_jax.tasks import Task

__all__ = ["MujocoPhysics"]

_CONTROL = int(mujoco.mjtState.mjSTATE_MOCAP_POS)
MODELS = 256  # that are kept
FIRST_LOOK = 8  # steps, after which most problems rest


class MujocoPhysics:
    """`Physics` by C MuJoCo; NumPy in and out."""

    name = "mujoco"
    description = "MuJoCo's C engine"

    def __init__(self, task: Task, *, threads: int | None = None) -> None:
        self.task = task
        self.threads = threads or os.cpu_count() or 1
        self._pool = Rollout(nthread=self.threads if self.threads > 1 else 0)
        self._data: dict[int, list[mujoco.MjData]] = {}
        self._models: dict[bytes, mujoco.MjModel] = {}
        bodies = [thing.body for thing in task.objects]
        self._body = np.array([bodies.index(body) for body in bodies])  # equal bodies have the same number
        self._model(self._body.astype(np.int8).tobytes())  # says before anything begins if MuJoCo refuses the task

    def settle(
        self, kits: Float32[np.ndarray, "S T 3"], poses: Float32[np.ndarray, "S B 7"], present: Bool[np.ndarray, "S B"]
    ) -> Settled:
        """See `Physics.settle`."""
        kits, poses, present = np.asarray(kits), np.asarray(poses), np.asarray(present)
        counts = present.sum(axis=1)
        result = Settled(
            poses=poses.astype(np.float32),
            ok=np.ones(len(poses), bool),
            steps=np.zeros(len(poses), np.int32),
            reach=np.zeros(poses.shape[:2], np.float32),
        )
        for count in range(1, poses.shape[1] + 1):
            rows = np.flatnonzero(counts == count)
            # What is not at rest after a few steps begins again in longer pieces, so that the result is theirs.
            for pieces in ((FIRST_LOOK,), tuple(_pieces(timing(self.task).most_steps))):
                if rows.size:
                    rows = rows[
                        ~self._settle_equal(rows, count, kits[rows], poses[rows], present[rows], pieces, result)
                    ]
        return result

    def _settle_equal(
        self,
        rows: Int[np.ndarray, " n"],
        count: int,
        kits: Float32[np.ndarray, "n T 3"],
        poses: Float32[np.ndarray, "n B 7"],
        present: Bool[np.ndarray, "n B"],
        pieces: tuple[int, ...],
        result: Settled,
    ) -> Bool[np.ndarray, " n"]:
        """Simulate problems with equally many objects, in pieces of so many steps, until they rest; write them into
        `result`, and return which of them do."""
        index = np.nonzero(present)[1].reshape(-1, count)
        index = np.take_along_axis(index, np.argsort(self._body[index], axis=1, kind="stable"), axis=1)
        start = np.take_along_axis(poses, index[..., None], axis=1).astype(np.float64)
        models = [self._model(bodies) for bodies in row_names(self._body[index].astype(np.int8))]
        if count not in self._data:
            self._data[count] = [mujoco.MjData(models[0]) for _ in range(self.threads)]
        data = self._data[count]
        state = np.zeros((len(rows), 1 + 13 * count))
        state[:, 1 : 1 + 7 * count] = start.reshape(len(rows), -1)
        quiet = _Quiet(self.task, start)
        active = np.arange(len(rows))
        for nstep in pieces:
            places = kits[active].reshape(len(active), 1, -1).astype(np.float64)
            control = np.broadcast_to(places, (len(active), nstep, places.shape[2]))
            trajectory = np.empty((len(active), nstep, state.shape[1]))
            self._pool.rollout(
                [models[i] for i in active],
                data,
                state[active],
                np.ascontiguousarray(control),
                control_spec=_CONTROL,
                nstep=nstep,
                state=trajectory,
                skip_checks=True,
            )
            rest = quiet.update(active, trajectory)
            state[active] = trajectory[:, -1]
            active = active[~rest]
            if not active.size:
                break
        np.put_along_axis(placed := result.poses[rows], index[..., None], quiet.poses.astype(np.float32), axis=1)
        np.put_along_axis(reach := result.reach[rows], index, quiet.reach.astype(np.float32), axis=1)
        result.poses[rows], result.reach[rows] = placed, reach
        result.ok[rows], result.steps[rows] = quiet.ok, quiet.steps
        return np.isin(np.arange(len(rows)), active, invert=True)

    def _model(self, bodies: bytes) -> mujoco.MjModel:
        """Return the model of objects with the bodies of these numbers, one int8 each and ascending; objects that only
        differ in name and colour share it."""
        if bodies not in self._models:
            if len(self._models) >= MODELS:
                self._models.clear()
            numbers = np.frombuffer(bodies, np.int8)
            alike = [np.flatnonzero(self._body == number).tolist() for number in range(len(self._body))]
            chosen = [self.task.object_names[alike[number].pop(0)] for number in numbers]
            self._models[bodies] = compile_scene(self.task, tuple(chosen))[0]
        return self._models[bodies]


class _Quiet:
    """The state of the rest criterion of a batch, and what it has found."""

    def __init__(self, task: Task, start: Float64[np.ndarray, "S B 7"]) -> None:
        self.scales = timing(task)
        self.start = start
        self.poses = start.copy()
        self.ok = np.ones(len(start), bool)
        self.steps = np.zeros(len(start), np.int32)
        self.reach = np.zeros(start.shape[:2])
        self.slow = np.zeros((len(start), QUIET_STEPS - 1), bool)  # whether the last steps were slow
        self.before = np.zeros(len(start))  # how fast the last step was
        self.anchor = np.zeros_like(start)  # where a window began
        self.wandered = np.zeros(len(start))  # how far anything went since, 1 being too far to have only rocked

    def update(
        self, active: Int[np.ndarray, " n"], trajectory: Float64[np.ndarray, "n T state"]
    ) -> Bool[np.ndarray, " n"]:
        """Take in a piece of the motion of the active problems; return which of them are done."""
        boxes = self.start.shape[1]
        batch, nstep, _ = trajectory.shape
        qpos = trajectory[:, :, 1 : 1 + 7 * boxes].reshape(batch, nstep, boxes, 7)
        qvel = trajectory[:, :, 1 + 7 * boxes :].reshape(batch, nstep, boxes, 6)
        scales = self.scales
        pace = np.maximum(
            np.linalg.norm(qvel[..., :3], axis=-1) / scales.speed, np.linalg.norm(qvel[..., 3:], axis=-1) / scales.spin
        ).max(axis=-1)
        sane = np.isfinite(trajectory).all(axis=-1) & (np.abs(qpos[..., :3]) < scales.far).all(axis=(-1, -2))
        offset = np.linalg.norm(qpos[..., :2] - self.start[active, None, :, :2], axis=-1)
        slow = (pace < 1) & (pace < np.column_stack([self.before[active], pace[:, :-1]]) + 0.01)
        slow = np.column_stack([self.slow[active], slow])
        quiet = np.logical_and.reduce([slow[:, i : i + nstep] for i in range(QUIET_STEPS)])
        ends = quiet | ~sane
        ends[:, -1] |= self._rocks(active, qpos)
        done = ends.any(axis=1)
        last = np.where(done, ends.argmax(axis=1), nstep - 1)
        rows = np.arange(batch)
        fine = sane[rows, last]
        kept = np.where(fine, last, last - 1)  # the step whose poses count; -1: those of the piece before
        counts = (np.arange(nstep) <= kept[:, None])[..., None]
        self.reach[active] = np.maximum(self.reach[active], np.where(counts, offset, 0).max(axis=1))
        moved = kept >= 0
        self.poses[active[moved]] = qpos[rows[moved], kept[moved]]
        self.ok[active[~fine]] = False
        self.steps[active] += last + 1
        self.slow[active], self.before[active] = slow[:, nstep:], pace[:, -1]
        return done

    def _rocks(
        self, active: Int[np.ndarray, " n"], qpos: Float64[np.ndarray, "n T B 7"]
    ) -> Bool[np.ndarray, " n"] | bool:
        """Take in a piece of a window; return which problems have only rocked in place, if it is over."""
        window, begun = self.scales.window, int(self.steps[active[0]])
        if begun < window:
            return False
        if begun % window == 0:
            self.anchor[active], self.wandered[active] = qpos[:, 0], 0
        away = np.abs(qpos - self.anchor[active, None]) / ([self.scales.rocking] * 3 + [ROCKING_TURN] * 4)
        self.wandered[active] = np.maximum(self.wandered[active], away.max(axis=(1, 2, 3)))
        return ((begun + qpos.shape[1]) % window == 0) & (self.wandered[active] < 1)


def _pieces(most: int) -> Iterator[int]:
    """Yield numbers of steps between two checks for rest, `most` together: often while most problems end."""
    done = 0
    while done < most:
        nstep = min(8 if 16 <= done < 32 else 16, most - done)
        yield nstep
        done += nstep
