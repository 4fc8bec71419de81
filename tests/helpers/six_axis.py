"""A robot that the package does not know: one arm of six joints with a parallel gripper, by the nominal Denavit-Hartenberg
parameters that Universal Robots publishes for the UR3e. Its shapes, masses and gripper are made up for the tests."""

import numpy as np
from scipy.spatial.transform import Rotation

from bt_jax.deploy.robot.model import ArmModel, GripperModel, JointModel, RobotModel
from bt_jax.deploy.robot.shapes import Box, Capsule, Link, LinkShape, Placement

# Standard parameters of each joint: d [m], a [m], alpha [rad].
DH = (
    (0.15185, 0.0, np.pi / 2),
    (0.0, -0.24355, 0.0),
    (0.0, -0.2132, 0.0),
    (0.13105, 0.0, np.pi / 2),
    (0.08535, 0.0, -np.pi / 2),
    (0.0921, 0.0, 0.0),
)
MOUNT: Placement = ((-0.05, 0.0, 0.0), (0.0, 0.0, np.pi))
HOME = (0.0, -2.0, 2.0, -1.6, -1.57, 0.0)
RADII = (0.05, 0.045, 0.04, 0.035, 0.035, 0.03)


def _after(d: float, a: float, alpha: float) -> Placement:
    """The frame after a joint in that of the joint: a shift along z, one along x, and a turn about x."""
    return (a, 0.0, d), (alpha, 0.0, 0.0)


def _shape(link: int) -> LinkShape:
    d, a, _ = DH[link - 1]
    return LinkShape(link, Capsule((0, 0, 0), (a, 0, d), RADII[link - 1]))


_FINGER = (
    (Box((-0.006, 0.0065, 0.028), (0.008, 0.014, 0.056)), False),
    (Box((-0.001, 0.0065, 0.0443), (0.002, 0.016, 0.02)), True),
)
_PLACES: dict[Link, int] = {**{link: link for link in range(7)}, "hand": 7, "finger_a": 8, "finger_b": 8}
ARM = ArmModel(
    name="arm",
    joints=tuple(
        JointModel(str(i + 1), placement, -2 * np.pi, 2 * np.pi, np.pi)
        for i, placement in enumerate((MOUNT, *(_after(*row) for row in DH[:-1])))
    ),
    hand=_after(*DH[-1]),
    tcp=(0, 0, 0.13),
    gripper=GripperModel(
        stroke=0.03,
        fingers=(((0, -0.0065, 0.0837), (0, 0, 0)), ((0, 0.0065, 0.0837), (0, 0, np.pi))),
        force=40.0,
        speed=0.05,
    ),
    home=HOME,
    shapes=(
        *(_shape(link) for link in range(1, 6)),
        LinkShape("hand", Box((0, 0, 0.042), (0.09, 0.05, 0.08))),
        *(LinkShape(name, box, pad=pad) for name in ("finger_a", "finger_b") for box, pad in _FINGER),
    ),
    landmarks=(("wrist", 5), ("elbow", 3)),
    unchecked=tuple(  # its shapes are so rough that near ones overlap
        (a, b) for a, i in _PLACES.items() for b, j in _PLACES.items() if 0 < j - i < (4 if i else 3)
    ),
)
WORKSPACE = ((-0.5, -0.6, 0.0), (0.6, 0.6, 0.9))
SIX_AXIS = RobotModel("six_axis", (ARM,), WORKSPACE, (LinkShape(0, Box((-0.05, 0, 0.02), (0.15, 0.15, 0.04))),))


def denavit_hartenberg(joints: np.ndarray) -> np.ndarray:
    """The flange in the base frame, by the textbook's product of matrices."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", MOUNT[1]).as_matrix(), MOUNT[0]
    for theta, (d, a, alpha) in zip(joints, DH, strict=True):
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return pose
