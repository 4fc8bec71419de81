"""Grasps go along faces that fit between the fingers; puts turn an object as its place says, as far as its shape tells."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors.geometry import turn_error
from bt_jax.deploy.planning.grasps import carried_pose, grasp_poses, grip_width, put_poses, release_width
from bt_jax.deploy.planning.pose_geometry import plain
from bt_jax.tasks import Object

OPENING, GREY = 0.05, (0.5, 0.5, 0.5)
EDGES = st.floats(0.01, 0.12)
TURNS = st.floats(-math.pi, math.pi)
CUBOIDS = st.builds(lambda x, y, z: Object("Thing", color=GREY, size=(x, y, z)), EDGES, EDGES, EDGES)
CYLINDERS = st.builds(
    lambda radius, height: Object("Thing", color=GREY, size=(2 * radius, 2 * radius, height), shape="cylinder"),
    st.floats(0.006, 0.024),
    EDGES,
)
CUBES = st.builds(lambda edge: Object("Thing", color=GREY, size=(edge, edge, edge)), st.floats(0.01, 0.05))


def standing(turn: float, height: float = 0.2) -> RigidTransform:
    return RigidTransform.from_components([0.3, -0.1, height], Rotation.from_euler("z", turn))


@given(CUBOIDS, TURNS, st.floats(0, 0.03))
def test_fingers_close_on_a_pair_of_parallel_faces_that_fits(thing, turn, least):
    box = standing(turn)
    found = grasp_poses(box, thing, OPENING, least)
    for tcp in found:
        closing = box.rotation.inv().apply(tcp.rotation.apply([1.0, 0, 0]))
        across = int(np.argmax(np.abs(closing)))
        assert across < 2
        assert math.isclose(abs(closing[across]), 1.0, abs_tol=1e-9)
        assert grip_width(thing, tcp.inv() * box) == thing.size[across] <= OPENING + 0.001
        np.testing.assert_allclose(tcp.rotation.apply([0, 0, 1.0]), [0, 0, -1], atol=1e-9)
    fitting = [width for width in thing.size[:2] if width <= OPENING + 0.001]
    assert len(found) == (4 if thing.is_cube and fitting else 2 * len(fitting))


@given(st.one_of(CUBOIDS, CYLINDERS), TURNS, st.floats(0, 0.03))
def test_a_flat_object_is_grasped_above_what_is_beside_it_as_far_as_it_is_high(thing, turn, least):
    for tcp in grasp_poses(standing(turn), thing, OPENING, least):
        above_foot = tcp.translation[2] - 0.2 + thing.height / 2
        assert above_foot >= min(least, thing.height - 0.001) - 1e-9
        assert thing.height - 0.03 - 1e-9 <= above_foot <= max(thing.height, least) + 1e-9


def test_what_lies_on_its_side_has_nothing_to_grasp_it_by_unless_it_is_a_cube():
    lying = RigidTransform.from_components([0.3, 0, 0.2], Rotation.from_euler("x", math.pi / 2))
    assert not grasp_poses(lying, Object("Bar", color=GREY, size=(0.09, 0.03, 0.03)), OPENING)
    assert not grasp_poses(lying, Object("Can", color=GREY, size=(0.03, 0.03, 0.05), shape="cylinder"), OPENING)
    assert len(grasp_poses(lying, Object("Block", color=GREY, size=(0.04, 0.04, 0.04)), OPENING)) == 4


@given(st.one_of(CUBOIDS, CYLINDERS, CUBES), TURNS, TURNS, st.sampled_from([None, 0.0, 45.0, 90.0, -120.0, 180.0]))
def test_a_put_brings_an_object_to_its_place_and_turn_modulo_its_symmetry(thing, turn, yaw, wanted):
    place = np.array([0.25, 0.1, 0.05])
    for tcp in grasp_poses(standing(turn), thing, OPENING)[:2]:
        held = carried_pose(tcp, standing(turn), thing)
        groups = put_poses(place, yaw, held, thing, None if thing.shape == "cylinder" else wanted)
        for pose in (pose for group in groups for pose in group):
            put = pose * held
            np.testing.assert_allclose(put.translation, place, atol=1e-9)
            np.testing.assert_allclose(put.rotation.apply([0, 0, 1.0]), [0, 0, 1], atol=1e-6)
            if thing.shape != "cylinder":
                off = [turn_error(thing, plain(put), plain(standing(yaw)), way) for way in _ways(wanted)]
                assert min(map(abs, off)) < 1e-6
        directions = {round(float(np.rad2deg(pose.rotation.as_euler("zyx")[0])) % 360) % 360 for pose in groups[0]}
        assert len(directions) == {0: 8, 90: 4, 180: 2}[thing.symmetry]


def _ways(wanted: float | None) -> tuple[float, ...]:
    """Return the turns that a put without one may choose, degrees."""
    return (0.0, 90.0) if wanted is None else (wanted,)


@given(CUBOIDS, TURNS)
def test_fingers_let_go_no_wider_than_the_object_and_a_little_room(thing, turn):
    for tcp in grasp_poses(standing(turn), thing, OPENING):
        held = tcp.inv() * standing(turn)
        assert release_width(thing, held, OPENING) == min(grip_width(thing, held) + 0.012, OPENING)
