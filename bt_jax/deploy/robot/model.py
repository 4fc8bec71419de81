"""A robot as one table: its arms, their joints, limits, shapes and grippers; and forward kinematics in NumPy.

Every joint turns about the z of its frame. Lengths in metres, angles in radians, masses in kilograms. The order of an arm's
joints is that of its chain; the order in which a controller names its axes belongs to the link.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.robot.arrays import Joints, Point
from bt_jax.deploy.robot.shapes import Link, LinkShape, Placement, Vec3, highest, placement_matrix

__all__ = ["ArmModel", "GripperModel", "JointModel", "RobotModel"]


@dataclasses.dataclass(frozen=True)
class JointModel:
    """A revolute joint and the link that it moves. `placement` is in the link before, of the first joint in the body.

    `weight` is that of the joint in the distance between configurations. Mass, armature and stiffness are of the simulated
    robot.
    """

    label: str  # joints and links are named with it
    placement: Placement
    lower: float
    upper: float
    speed: float  # rad/s
    weight: float = 1.0
    mass: float = 1.0
    armature: float = 0.1  # kg m2, of the geared motor
    stiffness: float = 2000.0  # of the servo, Nm/rad
    acceleration: float = 20.0  # rad/s2, the largest


@dataclasses.dataclass(frozen=True)
class GripperModel:
    """Two parallel fingers, each of which moves by up to `stroke` along the -x of its placement in the hand. They close
    along the hand's x, and point along its z."""

    stroke: float
    fingers: tuple[Placement, Placement]
    force: float  # N, the largest
    speed: float  # m/s of each finger
    mass: float = 0.2  # without the fingers
    finger_mass: float = 0.02
    finger_armature: float = 0.2  # kg
    stiffness: float = 4000.0  # of a finger's servo, N/m
    damping: float = 100.0  # N s/m

    @property
    def opening(self) -> float:
        """The largest distance between the fingers."""
        return 2 * self.stroke

    @property
    def total_mass(self) -> float:
        """With its fingers."""
        return self.mass + 2 * self.finger_mass


@dataclasses.dataclass(frozen=True)
class ArmModel:
    """A chain of joints with a gripper at its end. `hand` is the flange's frame (tool0) in the last link, `tcp` the point
    between the finger tips in the hand. `landmarks` are links, by their number in the chain, whose origins must stay in the
    workspace. `unchecked` are pairs of links, besides neighbours, that never meet or always nearly touch."""

    name: str
    joints: tuple[JointModel, ...]
    hand: Placement
    tcp: Vec3
    gripper: GripperModel
    home: tuple[float, ...]
    shapes: tuple[LinkShape, ...]
    landmarks: tuple[tuple[str, int], ...]
    payload: float = float("inf")  # with the gripper
    unchecked: tuple[tuple[Link, Link], ...] = ()

    def __post_init__(self) -> None:
        if len(self.home) != len(self.joints):
            raise ValueError(f"the {self.name} arm has {len(self.joints)} joints, and its home {len(self.home)}")

    @functools.cached_property
    def lower(self) -> Joints:
        """The least angle of each joint."""
        return np.array([joint.lower for joint in self.joints])

    @functools.cached_property
    def upper(self) -> Joints:
        """The largest angle of each joint."""
        return np.array([joint.upper for joint in self.joints])

    @functools.cached_property
    def speed(self) -> Joints:
        """The largest speed of each joint, rad/s."""
        return np.array([joint.speed for joint in self.joints])

    @functools.cached_property
    def acceleration(self) -> Joints:
        """The largest acceleration of each joint, rad/s2."""
        return np.array([joint.acceleration for joint in self.joints])

    @functools.cached_property
    def weights(self) -> Joints:
        """The weight of each joint in the distance between configurations."""
        return np.array([joint.weight for joint in self.joints])

    @functools.cached_property
    def base(self) -> Point:
        """Where the first joint is in the robot's base frame."""
        return np.array(self.joints[0].placement[0], float)

    @functools.cached_property
    def length(self) -> float:
        """How far the point between the finger tips can be from the first joint at most."""
        steps = [placement for placement, _ in (*(joint.placement for joint in self.joints[1:]), self.hand)]
        return float(sum(map(np.linalg.norm, (*steps, self.tcp))))

    @functools.cached_property
    def below(self) -> float:
        """How far the fingers reach beyond the TCP along the hand's z, m; 0 if they have no shapes."""
        ends = {"finger_a": self.gripper.fingers[0][0][2], "finger_b": self.gripper.fingers[1][0][2]}
        tips = [ends[str(shape.link)] + highest(shape.solid) for shape in self.shapes if shape.link in ends]
        return max(tips, default=self.tcp[2]) - self.tcp[2]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of its joints in chain order."""
        return tuple(f"{self.name}_joint_{joint.label}" for joint in self.joints)

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """The names of the simulated servos in chain order."""
        return tuple(f"{self.name}_servo_{joint.label}" for joint in self.joints)

    @property
    def link_names(self) -> tuple[str, ...]:
        """The names of its moving links in chain order, without the hand."""
        return tuple(f"{self.name}_link_{joint.label}" for joint in self.joints)

    @property
    def finger_names(self) -> tuple[str, str]:
        """The names of the fingers, of their joints and of their simulated servos."""
        return f"{self.name}_finger_a", f"{self.name}_finger_b"

    def link_name(self, link: Link) -> str:
        """Return the name of the link that a shape of this arm belongs to."""
        return self.link_names[link - 1] if isinstance(link, int) else f"{self.name}_{link}"

    @property
    def links(self) -> tuple[Link, ...]:
        """The links that move, in chain order."""
        return (*range(1, len(self.joints) + 1), "hand", "finger_a", "finger_b")

    def may_meet(self, first: Link, second: Link) -> bool:
        """Can two links of this arm, or the body and a link, touch each other? Links with at most one joint between them
        cannot."""
        counts = [link if isinstance(link, int) else len(self.joints) + (link != "hand") for link in (first, second)]
        return abs(counts[0] - counts[1]) > 1 and not {(first, second), (second, first)} & self._unchecked

    @functools.cached_property
    def _unchecked(self) -> frozenset[tuple[Link, Link]]:
        return frozenset(self.unchecked)

    @functools.cached_property
    def _fixed(self) -> tuple[Float[np.ndarray, "4 4"], ...]:
        """The placements of the joints, then the TCP in the last link."""
        joints = [placement_matrix(joint.placement) for joint in self.joints]
        return (*joints, placement_matrix(self.hand) @ placement_matrix((self.tcp, (0, 0, 0))))

    def link_poses(self, joints: Joints) -> Float[np.ndarray, "links 4 4"]:
        """Return the frames of the links in chain order, then of the TCP, in the robot's base frame."""
        *fixed, tip = self._fixed
        poses, pose = np.empty((len(self.joints) + 1, 4, 4)), np.eye(4)
        for i, (matrix, cos, sin) in enumerate(zip(fixed, np.cos(joints), np.sin(joints), strict=True)):
            pose = pose @ matrix
            x, y = pose[:, 0].copy(), pose[:, 1].copy()
            pose[:, 0], pose[:, 1] = cos * x + sin * y, cos * y - sin * x
            poses[i] = pose
        poses[-1] = pose @ tip
        return poses

    def forward(self, joints: Joints) -> RigidTransform:
        """Return the TCP in the robot's base frame."""
        return RigidTransform.from_matrix(self.link_poses(np.asarray(joints, float))[-1])

    def flange(self, joints: Joints) -> RigidTransform:
        """Return tool0 in the robot's base frame."""
        return self.forward(joints) * RigidTransform.from_translation(self.tcp).inv()

    def points(self, joints: Joints) -> dict[str, Point]:
        """Return the points whose place is bounded, in the base frame: the TCP and the landmarks."""
        poses = self.link_poses(np.asarray(joints, float))
        return {"tcp": poses[-1, :3, 3]} | {name: poses[link - 1, :3, 3] for name, link in self.landmarks}


@dataclasses.dataclass(frozen=True)
class RobotModel:
    """A robot of one or more arms on one body, whose frame is the robot's base frame."""

    name: str
    arms: tuple[ArmModel, ...]
    workspace: tuple[Vec3, Vec3]  # least and largest coordinates of TCPs and landmarks in the base frame
    shapes: tuple[LinkShape, ...] = ()  # of the body
    example: str = ""  # a packaged task at its scale

    @property
    def body(self) -> str:
        """The name of the link that does not move."""
        return f"{self.name}_body"

    @functools.cached_property
    def arm_names(self) -> tuple[str, ...]:
        return tuple(arm.name for arm in self.arms)

    @functools.cached_property
    def home(self) -> Mapping[str, Joints]:
        """Where each arm rests."""
        return {arm.name: np.array(arm.home) for arm in self.arms}

    def arm(self, name: str) -> ArmModel:
        """Return an arm by its name. Raise KeyError if there is none of that name."""
        return self._by_name[name]

    @functools.cached_property
    def _by_name(self) -> Mapping[str, ArmModel]:
        return {arm.name: arm for arm in self.arms}

    def forward(self, arm: str, joints: Joints) -> RigidTransform:
        """Return the TCP of an arm in the base frame."""
        return self.arm(arm).forward(joints)

    def flange(self, arm: str, joints: Joints) -> RigidTransform:
        """Return tool0 of an arm in the base frame."""
        return self.arm(arm).flange(joints)

    def points(self, arm: str, joints: Joints) -> dict[str, Point]:
        """Return the points of an arm whose place is bounded, for `safety.Rules`, in the base frame."""
        return self.arm(arm).points(joints)
