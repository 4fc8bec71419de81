"""What goes wrong in the twin as the faults of its task say: the fates that the simulation draws happen to the robot.

The first attempt at an action meets the fate of an episode's first tick, the second that of its second, and so on; a tick of
events is a SIMULATED_TICK, as long as an attempt in the mean. Where an object ends that was dropped or misplaced, the skills
of the simulation say. No arm is touched: objects are put elsewhere, markers are covered, and fingers do not obey.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Vocabulary, expand
from bt_jax.deploy.execution.decision import Step
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import SIMULATED_TICK
from bt_jax.deploy.twin.cell import Qpos, TwinScene, box_poses
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.person import PersonsHand, Touch
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.simulated_gripper import GripperFault
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.faults.events import ALL_SEEN, SPOTS, brings, hides, moves, takes
from bt_jax.mjx_env.faults.fates import drawn, sample_fates
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Mishaps, act
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["FaultInjector", "check_faults", "true_world"]

LONGEST = 1000  # ticks for which fates are drawn
UNDER_WAY = (str(Step.ACTING), str(Step.UNSEEN), "committed")  # phases of an attempt
NEAR = 0.03  # m from its place within which an object was put there, and not down elsewhere
GAP = 0.0005  # m above what is below at which an object is put


def check_faults(task: Task, *, realtime: bool) -> None:
    """Raise UserError for faults that cannot be provoked here."""
    if realtime and task.faults is not None and task.faults.hide > 0:
        raise UserError("faults that hide objects need simulated time; leave out --realtime, or set hide to 0")


@dataclasses.dataclass
class _Attempt:
    command: int
    mishaps: Mishaps
    held: str | None  # when it began
    start: World  # the state then
    released: bool = False
    dropped: bool = False


class FaultInjector:
    """Does to the cell of a run what the fates of one episode say: those of `draw` in the layout `seed` of the program's
    task, which has faults. The same arguments give the same fates."""

    def __init__(
        self,
        program: Program,
        scene: TwinScene,
        controller: Controller,
        camera: RenderedCamera | None,
        seed: int,
        draw: int,
        start: float,
    ) -> None:
        task = program.task
        self.scene, self.start = scene, start
        self._controller, self._camera, self._task = controller, camera, task
        leaves = [node for node in prefix(expand(program.tree)) if isinstance(node, Behavior)]
        self._semantics = LeafSemantics(task, Vocabulary.of(leaves))
        self._variants = Variants(self._semantics)
        long = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=LONGEST))
        fates = sample_fates(long, seed, layouts=1, draws=draw + 1, continuous=True)
        assert fates is not None, "the task has no faults"
        self._fates = fates[draw : draw + 1]
        self._hand = PersonsHand(scene, controller, np.random.default_rng([seed, 5, draw]))
        self._persons, self._sights = _person_events(task), _sight_events(task)
        self._attempt: _Attempt | None = None
        self._attempts = self._ticks = 0
        self._due: list[tuple[str, str]] = []  # what a person does as soon as it can be done, and to what
        self._gone: set[str] = set()
        self._covered: set[str] = set()

    @property
    def touches(self) -> list[Touch]:
        """All that happened so far."""
        return self._hand.touches

    def __call__(self, now: float, shown: TickReport) -> Touch | None:
        """Return the last thing that happens now, None if nothing does."""
        before, qpos = len(self.touches), self._controller.state()[1]
        if self._attempt is not None:
            if shown.phase in UNDER_WAY:
                self._accompany(self._attempt, now, shown, qpos)
            else:
                self._end(self._attempt, now, qpos)
        if shown.phase == Step.STARTING and shown.action is not None:
            self._begin(shown.action, now, shown, qpos)
        while now - self.start >= SIMULATED_TICK * (self._ticks + 1):
            self._between_ticks(now, self._ticks % LONGEST)
            self._ticks += 1
        self._due = [(what, name) for what, name in self._due if not self._person_acts(now, what, name)]
        return self.touches[-1] if len(self.touches) > before else None

    def _begin(self, action: Behavior, now: float, shown: TickReport, qpos: Qpos) -> None:
        command = self._semantics.commands.index(action)
        row, tick = np.array([command], np.int32), np.array([self._attempts % LONGEST], np.int32)
        mishaps = self._variants.mishaps(row, *drawn(self._fates, self._variants, tick, row))
        self._attempts += 1
        holding = shown.seen.holding
        self._attempt = _Attempt(command, mishaps, holding, true_world(self.scene, qpos, holding))
        if mishaps.jams[0] or mishaps.slips[0]:
            self._controller.gripper_fault(GripperFault.JAM if mishaps.jams[0] else GripperFault.WEAK)
            self._tell(now, "jam" if mishaps.jams[0] else "slip", action.object or action.name)

    def _accompany(self, attempt: _Attempt, now: float, shown: TickReport, qpos: Qpos) -> None:
        """Drop what is carried once it has come as far as fate says."""
        attempt.released |= shown.phase == "committed"
        held = attempt.held
        if held is None or attempt.mishaps.share[0] >= 1 or attempt.dropped or attempt.mishaps.jams[0]:
            return
        if (
            shown.phase != "committed"
            and shown.seen.holding == held
            and self._way(attempt, qpos) >= attempt.mishaps.share[0]
        ):
            below = dataclasses.replace(attempt.mishaps, share=np.zeros(1, np.float32))
            self._controller.put(held, self._released(attempt, true_world(self.scene, qpos, held), below))
            attempt.dropped = True
            self._tell(now, "drop", held)

    def _end(self, attempt: _Attempt, now: float, qpos: Qpos) -> None:
        """Let the grippers work again, and push what was placed as far from its place as fate says."""
        self._attempt = None
        if attempt.mishaps.jams[0] or attempt.mishaps.slips[0]:
            self._controller.gripper_fault(GripperFault.NONE)
        if attempt.held is None or not attempt.released or attempt.dropped or not attempt.mishaps.error.any():
            return
        world, error = true_world(self.scene, qpos, attempt.held), attempt.mishaps.error
        place = self._released(attempt, world, dataclasses.replace(attempt.mishaps, error=np.zeros_like(error)))
        missed = self._released(attempt, world, attempt.mishaps)
        pose = box_poses(self.scene, qpos)[attempt.held]
        if np.linalg.norm(pose.translation - place.translation) > NEAR:
            return
        turn = Rotation.from_euler("z", float(error[0, 2]))
        shift = missed.translation - place.translation
        self._controller.put(
            attempt.held, RigidTransform.from_components(pose.translation + shift, turn * pose.rotation)
        )
        self._tell(now, "misplace", attempt.held)

    def _way(self, attempt: _Attempt, qpos: Qpos) -> float:
        """Return which share of the level way to its place what is carried has come."""
        whole = dataclasses.replace(attempt.mishaps, share=np.ones(1, np.float32))
        goal = self._released(attempt, attempt.start, whole).translation[:2]
        start = attempt.start.poses[0, int(attempt.start.held[0]), :2]
        here = box_poses(self.scene, qpos)[str(attempt.held)].translation[:2]
        return float(1 - np.linalg.norm(here - goal) / max(float(np.linalg.norm(start - goal)), 1e-9))

    def _released(self, attempt: _Attempt, world: World, mishaps: Mishaps) -> RigidTransform:
        """Return where the simulation's gripper would let go of what is held, a little above what is below."""
        released = act(self._semantics, world, np.array([attempt.command], np.int32), mishaps)
        pose = released.poses[0, int(world.held[0])].astype(float)
        return RigidTransform.from_components(
            pose[:3] + np.array([0, 0, GAP]), Rotation.from_quat(pose[3:], scalar_first=True)
        )

    def _between_ticks(self, now: float, tick: int) -> None:
        person, sight = int(self._fates.person[0, tick]), int(self._fates.sight[0, tick])
        self._due = [(what, name) for what, name in self._due if what == "return"]
        if person in self._persons:
            self._due.append(self._persons[person])
        if sight in self._sights:
            self._hide(now, self._sights[sight])

    def _hide(self, now: float, hidden: str | None) -> None:
        """Have the camera lose sight of one object, and of no other."""
        assert self._camera is not None, "check_faults refuses it"
        for name in self._covered - {hidden}:
            self._camera.uncover(name)
            self._tell(now, "show", name)
        self._covered &= {hidden}
        if hidden is not None and hidden not in self._covered:
            self._camera.cover(hidden)
            self._covered.add(hidden)
            self._tell(now, "hide", hidden)

    def _person_acts(self, now: float, what: str, name: str) -> bool:
        """Do it if it can be done now. Return whether nothing of it is left."""
        if what == "return":
            if name in self._gone and self._hand.bring(now, name) is not None:
                self._gone.discard(name)
            return name not in self._gone
        if name in self._gone:
            return True
        if name not in self._hand.free():
            return False
        if what == "move":
            return self._hand.move(now, name) is not None
        self._hand.take(now, name)
        self._gone.add(name)
        return True

    def _tell(self, now: float, what: str, name: str) -> None:
        self.touches.append(Touch(now, what, name))


def true_world(scene: TwinScene, qpos: Qpos, holding: str | None) -> World:
    """Return the state of the twin's cell as the simulation has it, a batch of one (NumPy), with what a hand holds."""
    task, poses = scene.task, box_poses(scene, qpos)
    rows = [[*pose.translation, *pose.rotation.as_quat(scalar_first=True)] for pose in poses.values()]
    return World(
        kits=np.array([[scene.kits[name].translation for name in task.kit_names]], np.float32),
        poses=np.array([rows], np.float32),
        held=np.array([-1 if holding is None else task.object_names.index(holding)], np.int8),
        gripper_open=np.array([holding is None]),
        reached=np.zeros((1, len(task.subgoals)), bool),
        unseen=np.zeros((1, len(task.objects)), bool),
    )


def _person_events(task: Task) -> dict[int, tuple[str, str]]:
    """Return what a person does in each event, as `Touch` has it, and to which object."""
    found: dict[int, tuple[str, str]] = {}
    for i, name in enumerate(task.object_names):
        found[int(takes(task, i))] = ("remove", name)
        for spot in range(SPOTS):
            found[int(moves(task, i, spot))] = ("move", name)
            found[int(brings(task, i, spot))] = ("return", name)
    return found


def _sight_events(task: Task) -> dict[int, str | None]:
    """Return which object is out of sight after each event of sight, None for no object."""
    return {ALL_SEEN: None, **{int(hides(i)): name for i, name in enumerate(task.object_names)}}
