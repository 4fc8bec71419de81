"""Solids on the links of a robot and around it, and how far pairs of them are apart: Pinocchio and Coal.

Most pairs are far from each other, which the spheres around both solids tell for all pairs at once; only where spheres are
near is the distance of the solids themselves worked out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.robot.arrays import Joints, Point
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import Box, Capsule, Cylinder, Hull, Solid
from bt_jax.deploy.robot.urdf import urdf

__all__ = ["CollisionModel"]

THIN = 1e-4  # m, the radius of a line's capsule

PairValues = Float[np.ndarray, " pairs"]


class CollisionModel:
    """Solids are numbered in the order in which they are added. Poses are in the frame of the link that a solid is on."""

    def __init__(self, robot: RobotModel) -> None:
        self.robot, self.names = robot, list[str]()
        self._model = pin.buildModelFromXML(urdf(robot))
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._columns = {
            arm.name: [self._column(name) for name in arm.joint_names]
            + [self._column(f"{name}_joint") for name in arm.finger_names]
            for arm in robot.arms
        }
        self._geometry = pin.GeometryModel()
        self._centres: list[RigidTransform] = []  # of the solids in their poses
        self._radii: list[float] = []

    def add(self, name: str, link: str, pose: RigidTransform, solid: Solid) -> int:
        """Add a solid to a link or another frame of the robot; return its number."""
        shape, centre = _about_centre(solid)
        frame = self._model.getFrameId(link)
        self.names.append(name)
        self._centres.append(centre)
        self._radii.append(_radius(shape))
        number = len(self.names) - 1
        thing = pin.GeometryObject(f"{name}:{number}", self._model.frames[frame].parentJoint, frame, pin.SE3(), shape)
        self._geometry.addGeometryObject(thing)
        self.place(number, pose)
        return number

    def place(self, number: int, pose: RigidTransform) -> None:
        """Move a solid on its link."""
        thing = self._geometry.geometryObjects[number]
        pose_in_joint = self._model.frames[thing.parentFrame].placement
        thing.placement = pose_in_joint * pin.SE3((pose * self._centres[number]).as_matrix())

    def watch(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Say, once and after all solids are added, which pairs of solids count."""
        pairs = list(pairs)
        for pair in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(*pair))
        self._first, self._second = np.array(pairs, int).reshape(-1, 2).T
        self._reach = np.array(self._radii)[self._first] + np.array(self._radii)[self._second]
        self._state = pin.GeometryData(self._geometry)

    def move(self, joints: Mapping[str, Joints], opening: Mapping[str, float]) -> PairValues:
        """Move the arms and open their grippers, wide without an `opening`; return what each pair is apart at least, m."""
        for arm, columns in self._columns.items():
            finger = opening.get(arm, self.robot.arm(arm).gripper.opening) / 2
            self._q[columns] = (*joints[arm], finger, finger)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._state, self._q)
        centres = np.array([placement.translation for placement in self._state.oMg])
        between = centres[self._first] - centres[self._second]
        return np.sqrt(np.einsum("pk,pk->p", between, between)) - self._reach

    def distance(self, pair: int) -> float:
        """Return how far a pair is apart, where the arms were moved to, m; negative if they overlap."""
        return pin.computeDistance(self._geometry, self._state, pair).min_distance

    def is_near_line(self, start: Point, end: Point, margin: float) -> bool:
        """Is a solid nearer than `margin` [m] to the straight line between two points, where the arms were moved to?"""
        along = end - start
        length = float(np.linalg.norm(along))
        centres = np.array([placement.translation for placement in self._state.oMg])
        share = np.clip((centres - start) @ along / length**2, 0, 1)
        bounds = np.linalg.norm(centres - start - share[:, None] * along, axis=1) - self._radii
        solid, middle = Capsule(tuple(start), tuple(end), THIN), (start + end) / 2
        line, pose = _about_centre(solid)
        at = coal.Transform3s(pose.rotation.as_matrix(), middle)
        return any(self._apart(line, at, int(number)) + THIN < margin for number in np.flatnonzero(bounds < margin))

    def _apart(self, shape: coal.ShapeBase, at: coal.Transform3s, number: int) -> float:
        """Return how far a shape is from a solid, m."""
        place = self._state.oMg[number]
        solid = self._geometry.geometryObjects[number].geometry
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        own = coal.Transform3s(place.rotation, place.translation)
        return float(coal.distance(shape, at, solid, own, request, result))

    def _column(self, joint: str) -> int:
        return self._model.joints[self._model.getJointId(joint)].idx_q


def _about_centre(solid: Solid) -> tuple[coal.ShapeBase, RigidTransform]:
    """Return a solid about its centre, and where that is. The axis of a capsule is its z."""
    match solid:
        case Box(centre, edges):
            return coal.Box(*edges), RigidTransform.from_translation(centre)
        case Capsule(start, end, radius):
            axis = np.subtract(end, start)
            turn = Rotation.align_vectors([axis], [[0, 0, 1.0]])[0]
            middle = RigidTransform.from_components(np.add(start, end) / 2, turn)
            return coal.Capsule(radius, float(np.linalg.norm(axis))), middle
        case Cylinder(radius, height):
            return coal.Cylinder(radius, height), RigidTransform.identity()
        case Hull(corners):
            points, centre = coal.StdVec_Vec3s(), (np.max(corners, axis=0) + np.min(corners, axis=0)) / 2
            points.extend(list(np.array(corners) - centre))
            return coal.Convex.convexHull(points, True, "Qt"), RigidTransform.from_translation(centre)


def _radius(shape: coal.ShapeBase) -> float:
    """Return the radius of a sphere around the origin that holds a shape."""
    if isinstance(shape, coal.Box):
        return float(np.linalg.norm(shape.halfSide))
    if isinstance(shape, coal.Capsule):
        return shape.radius + shape.halfLength
    if isinstance(shape, coal.Cylinder):
        return float(np.hypot(shape.radius, shape.halfLength))
    return max(float(np.linalg.norm(shape.point(k))) for k in range(shape.num_points))
