"""A link whose arms follow their paths exactly in simulated time, and whose fingers close on what is between them."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.protocol import ArmState
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task
from tests.helpers.ideal import SimulatedTime

TICK = 0.1
FINGERS = 0.05  # m/s
NEAR = 0.012  # m from between the fingers at which they close on a box


class FollowingLink(SimulatedTime):
    """`boxes` are where boxes and kit are, base frame; one in the fingers moves with them. `hidden` are not seen, and
    nothing hides those that are `missing`."""

    def __init__(self, task: Task, boxes: dict[str, RigidTransform], robot: RobotModel = YUMI) -> None:
        super().__init__()
        self.robot, self.arms = robot, robot.arm_names
        self.boxes, self.size = dict(boxes), task.objects[0].edge
        self.joints = {arm: robot.home[arm].copy() for arm in self.arms}
        self.paths: dict[str, tuple[float, Trajectory] | None] = dict.fromkeys(self.arms)
        self.motions = dict.fromkeys(self.arms, 0)
        self.openings = {arm: robot.arm(arm).gripper.opening for arm in self.arms}
        self.targets = dict(self.openings)
        self.held: dict[str, tuple[str, RigidTransform]] = {}
        self.hidden, self.missing = set[str](), set[str]()
        self.grips: list[tuple[str, float]] = []

    def follow(self, arm: str, trajectory: Trajectory) -> int:
        assert np.abs(trajectory.joints[0] - self.joints[arm]).max() < 0.02
        self.paths[arm], self.motions[arm] = (self.time, trajectory), self.motions[arm] + 1
        return self.motions[arm]

    def halt(self, arm: str) -> None:
        super().halt(arm)
        self.paths[arm] = None

    def grip(self, arm: str, opening: float, force: float = 10.0) -> None:
        self.targets[arm] = opening
        self.grips.append((arm, opening))

    def arm(self, arm: str) -> ArmState:
        joints = self.joints[arm]
        moving = self.paths[arm] is not None
        return ArmState(
            self.time, joints, np.zeros_like(joints), joints, moving, self.motions[arm], 0.0, True, None,
            self.openings[arm], self.targets[arm],
        )  # fmt: skip

    def wait(self, until: float) -> None:
        super().wait(until)
        for arm in self.arms:
            path = self.paths[arm]
            if path is not None:
                start, trajectory = path
                at = min(self.time - start, trajectory.duration)
                self.joints[arm] = np.array([np.interp(at, trajectory.times, row) for row in trajectory.joints.T])
                if at >= trajectory.duration:
                    self.paths[arm] = None
            if arm in self.held:
                box, pose = self.held[arm]
                self.boxes[box] = self.robot.forward(arm, self.joints[arm]) * pose
            self._move_fingers(arm)

    def _move_fingers(self, arm: str) -> None:
        tcp, target = self.robot.forward(arm, self.joints[arm]), self.targets[arm]
        if target < self.size - 0.001:
            between = [n for n, p in self.boxes.items() if np.linalg.norm(p.translation - tcp.translation) < NEAR]
            if between and arm not in self.held and self.openings[arm] <= self.size + 0.006:
                self.held[arm] = between[0], tcp.inv() * self.boxes[between[0]]
            target = self.size if between else target
        elif arm in self.held:
            del self.held[arm]
        self.openings[arm] += float(np.clip(target - self.openings[arm], -FINGERS * TICK, FINGERS * TICK))

    def seen(self) -> Observation:
        """As one sees it who sees everything that is not hidden."""
        holding = next((box for box, _ in self.held.values()), None)
        poses = {name: pose for name, pose in self.boxes.items() if name not in self.hidden}
        missing = tuple(Finding(name, f"{name} is not seen", missing=True) for name in sorted(self.missing))
        return Observation(self.time, poses, dict(self.openings), holding, findings=missing)


def carried_out(skills: RobotSkills, link: FollowingLink, action, *, seconds=60.0, each=lambda: None) -> Status:
    """Drives one attempt to its end; `each` is called at every tick."""
    skills.start(action, link.seen())
    while link.time < seconds:
        status = skills.poll(link.seen())
        if status != Status.RUNNING:
            return status
        each()
        link.wait(link.time + TICK)
    raise AssertionError(f"still running after {seconds} s")
