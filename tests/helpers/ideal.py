"""The executor's other side without a robot: simulated time, and the idealized gripper of the simulation as skills."""

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import Behavior, gene_pool
from bt_jax.deploy.execution.executor import Executor
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.link.protocol import ArmState, Counters
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act, settled_world
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task, load_task

TASK = load_task("stack3")
SEMANTICS = LeafSemantics(TASK, gene_pool(TASK))
SETTLER = Settler(TASK, Kinematic(TASK))
STACK3 = parse_tree("""
Sequence
  move(YellowBox, (0, 0, 0.055), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
  move(BlueBox, (0, 0, 0.1), GreenBox)
""")


def observe(task: Task, world: World, time: float = 0.0, unknown: tuple[str, ...] = ()) -> Observation:
    """A state, a batch of one, as a robot that sees everything knows it; without the objects in `unknown`."""
    poses = {
        name: RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:], scalar_first=True))
        for name, pose in zip(task.object_names, world.poses[0].astype(float), strict=True)
    }
    poses[task.kits[0].name] = RigidTransform.from_translation(world.kits[0, 0].astype(float))
    base = RigidTransform.from_translation(task.robot_position).inv()
    held = int(world.held[0])
    opening = task.gripper_opening * float(world.gripper_open[0])
    return Observation(
        time=time,
        poses={name: base * pose for name, pose in poses.items() if name not in unknown},
        opening={"left": opening, "right": opening},
        holding=None if held < 0 else task.object_names[held],
    )


class SimulatedTime:
    """A link without a robot: time passes when it is waited for."""

    arms = ("left", "right")

    def __init__(self) -> None:
        self.time, self.reason = 0.0, None
        self.halted: list[str] = []

    def now(self) -> float:
        return self.time

    def wait(self, until: float) -> None:
        self.time = max(self.time, until)

    def stopped(self) -> str | None:
        return self.reason

    def stop(self, reason: str) -> str:
        self.reason = self.reason or reason
        return ""

    def halt(self, arm: str) -> None:
        self.halted.append(arm)

    def interrupt(self) -> None:
        self.halted += self.arms

    def arm(self, arm: str) -> ArmState:
        raise NotImplementedError("there are no arms")

    def follow(self, arm: str, trajectory: Trajectory) -> int:
        raise NotImplementedError("there are no arms")

    def grip(self, arm: str, opening: float, force: float = 10.0) -> None:
        raise NotImplementedError("there are no grippers")

    def counters(self) -> Counters:
        return Counters(0, 0, 0, 0, 0, 0, 0)


class IdealSkills:
    """Each attempt takes some polls, then the simulation's command is carried out at once."""

    def __init__(self, semantics: LeafSemantics, settler: Settler, world: World, *, polls: int = 3) -> None:
        self.semantics, self.settler, self.world = semantics, settler, world
        self.polls, self.left = polls, 0
        self.committed, self.reason, self.fault = False, "", ""
        self.action: Behavior | None = None
        self.started: list[Behavior] = []
        self.cancelled: list[Behavior | None] = []
        self.looks = 0
        self.out_of_reach: set[str] = set()

    def start(self, action: Behavior, seen: Observation) -> None:
        self.started.append(action)
        self.action, self.left = action, self.polls

    def look(self) -> None:
        self.looks += 1
        self.action, self.left = None, self.polls

    def poll(self, seen: Observation) -> Status:
        self.left -= 1
        if self.left > 0:
            return Status.RUNNING
        if self.action is not None and self.action.name == "look":
            return Status.SUCCESS if self.action.object in seen.poses else Status.RUNNING
        if self.action is not None:
            command = np.array([self.semantics.commands.index(self.action)], np.int32)
            released = act(self.semantics, self.world, command)
            poses, _ = self.settler.settle(released)
            self.world = settled_world(self.semantics.task, released, poses)
        return Status.SUCCESS

    def cancel(self) -> None:
        self.cancelled.append(self.action)

    def reachable(self, name: str, seen: Observation) -> bool:
        return name not in self.out_of_reach


class IdealCell:
    """An executor with ideal skills; `hide` are objects that are not seen, `image` the age of images."""

    def __init__(self, tree=STACK3, *, task=TASK, seed=0, log=None, **options):
        semantics, settler = SEMANTICS, SETTLER
        if task is not TASK:
            semantics, settler = LeafSemantics(task, gene_pool(task)), Settler(task, Kinematic(task))
        self.task, self.skills = task, IdealSkills(semantics, settler, sample_layouts(task, seed, 1))
        self.link, self.hide, self.image = SimulatedTime(), set(), 0.0
        self.lost, self.findings = "", ()
        self.shown = []
        self.on_tick = lambda shown: None
        self.executor = Executor(
            Program(task, tree),
            skills=self.skills,
            link=self.link,
            observe=self.observe,
            log=log or Log(None),
            on_tick=self.tick,
            **options,
        )

    def observe(self):
        hide = tuple(self.hide)
        seen = observe(self.task, self.skills.world, self.link.now(), hide)
        return dataclasses.replace(seen, image=seen.time - self.image, lost=self.lost, findings=self.findings)

    def tick(self, shown):
        self.shown.append(shown)
        self.on_tick(shown)

    def move(self, name, position):
        """As a person does."""
        poses = self.skills.world.poses.copy()
        poses[0, self.task.object_names.index(name), :3] = position
        self.skills.world = dataclasses.replace(self.skills.world, poses=poses)
