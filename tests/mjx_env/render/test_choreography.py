import dataclasses
import itertools
import math

import mujoco
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, gene_pool
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.choreography import shots
from bt_jax.mjx_env.render.film import check_film, film, final_picture
from bt_jax.mjx_env.render.offscreen import Renderer, available
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.scene.mjcf import GRIPPER, compile_scene
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import headings
from bt_jax.tasks import load_task
from tests.helpers.samples import MIXED

FPS = 30.0
STACK = "Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox), {})"
LAST = {
    "stack3": "move(BlueBox, (0, 0, 0.1), GreenBox)",
    "topple": "move(BlueBox, (0.07, 0.01, 0.1), GreenBox)",
    "gripper": "pick(GreenBox)",
}
draws = pytest.mark.skipif(available() is not True, reason="nothing can be drawn here")


def episode(last, *, seed=0, level="physics"):
    return played_tree("stack3", STACK.format(LAST[last]), seed=seed, level=level)


def played_tree(name, text, *, seed, level="physics"):
    task, tree = load_task(name), parse_tree(text)
    leaves = [node for node in prefix(tree) if isinstance(node, Behavior)]
    semantics = LeafSemantics(task, gene_pool(task).extended(leaves))
    physics = Kinematic(task) if level == "kinematic" else make_physics(task, "mujoco")
    return semantics, play(semantics, Settler(task, physics), tree, sample_layouts(task, seed, 1))


@pytest.mark.parametrize("level", ["kinematic", "physics"])
@pytest.mark.parametrize("last", LAST)
def test_motion_is_continuous_and_leads_from_start_to_end(last, level):
    semantics, played = episode(last, level=level)
    taken = shots(semantics, played, fps=FPS)
    poses = np.array([shot.poses for shot in taken])
    tips = np.array([shot.gripper.position for shot in taken])
    np.testing.assert_allclose(poses[0], played.start.poses[0], atol=1e-6)
    np.testing.assert_allclose(poses[-1], played.final.poses[0], atol=1e-6)
    assert np.abs(np.diff(tips, axis=0)).max() < 0.12
    assert np.abs(np.diff(poses[..., :3], axis=0)).max() < 0.15
    assert np.abs(np.diff([shot.gripper.opening for shot in taken])).max() < 0.05
    np.testing.assert_allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1, atol=1e-3)
    assert len(taken) / FPS < 3 + 2.5 * len(played.ticks)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_carried_through_another_box(seed):
    semantics, played = episode("stack3", seed=seed)
    assert played.solved
    for shot in shots(semantics, played, fps=FPS):
        centres = shot.poses[:, :3]
        gap = np.abs(centres[:, None] - centres[None]).max(axis=-1) + np.eye(3)
        assert gap.min() > 0.097


def test_a_grasped_box_stays_between_the_fingers():
    semantics, played = episode("stack3")
    taken = shots(semantics, played, fps=FPS)
    size, moved = semantics.task.objects[0].edge, 0
    for before, after in itertools.pairwise(taken):
        if after.gripper.opening == pytest.approx(size, abs=1e-6) == before.gripper.opening:
            away = np.linalg.norm(after.poses[:, :3] - after.gripper.position, axis=-1)
            assert away.min() < 1e-3
            moved += 1
    assert moved > 2 * FPS


def deepest(task, kits, taken):
    """How deep the gripper is ever inside something [m], and in what; objects may touch the fingers."""
    model, ids = compile_scene(task, gripper=True)
    data = mujoco.MjData(model)
    data.mocap_pos[list(ids.kit_mocaps)] = kits
    parts = [model.body(name).id for name in GRIPPER]
    solid = np.flatnonzero(model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    own, others = ([g for g in solid if (model.geom_bodyid[g] in parts) == is_own] for is_own in (True, False))
    found = (0.0, "")
    for shot in taken:
        data.qpos[:] = np.asarray(shot.poses, float).ravel()
        along = shot.gripper.opening / 2 * np.array([math.cos(shot.gripper.yaw), math.sin(shot.gripper.yaw), 0])
        mocaps = model.body_mocapid[parts]
        data.mocap_pos[mocaps] = np.asarray(shot.gripper.position) + np.array([0 * along, along, -along])
        data.mocap_quat[mocaps] = (math.cos(shot.gripper.yaw / 2), 0, 0, math.sin(shot.gripper.yaw / 2))
        mujoco.mj_kinematics(model, data)
        for a, b in itertools.product(own, others):
            body = model.body(int(model.geom_bodyid[b])).name
            found = min(found, (mujoco.mj_geomDistance(model, data, int(a), int(b), 0.01, None), body))
    return found


def test_the_gripper_comes_down_upright_and_open_and_goes_through_nothing():
    moves = "move(Bar, (0, 0, 0.0225), Tray, 90), move(Can, (0.13, 0.09, 0.0525), Tray)"
    semantics, played = played_tree("kit4", f"Sequence({moves})", seed=[5, 1])
    assert played.ending == Ending.SUCCESS
    depth, body = deepest(semantics.task, played.start.kits[0], shots(semantics, played, fps=12.0))
    assert depth > -1e-3, body


@pytest.mark.parametrize("seed", range(2))
def test_an_object_that_is_to_lie_turned_turns_with_the_hand(seed):
    moves = (
        "move(Plate, (-0.1, 0, 0.0125), TrayA, 90), move(Bolt, (-0.13, -0.0725, 0.0325), TrayB),"
        "move(Brick, (0.1, 0, 0.0325), TrayA, 45), pick(Can)"
    )
    semantics, played = played_tree(MIXED, f"Sequence({moves})", seed=seed)
    assert played.ending == Ending.SUCCESS
    widths = {"Plate": 0.1, "Bolt": 0.024, "Brick": 0.06, "Can": 0.06}
    names, seen = semantics.task.object_names, dict.fromkeys(widths, 0)
    for before, after in itertools.pairwise(shots(semantics, played, fps=FPS)):
        away = np.linalg.norm(after.poses[:, :2] - after.gripper.position[:2], axis=-1)
        moved = np.abs(after.poses[:, :3] - before.poses[:, :3]).max(axis=-1) > 1e-3
        for row in np.flatnonzero(moved & (away < 1e-6)):
            name = next(part for part in widths if names[row].startswith(part))
            seen[name] += 1
            assert after.gripper.opening == pytest.approx(widths[name])
            turns = [headings(np.float32(shot.poses[row, 3:])) - shot.gripper.yaw for shot in (before, after)]
            assert math.remainder(turns[1] - turns[0], 2 * math.pi) == pytest.approx(0, abs=1e-3)
    assert min(seen.values()) >= 0.2 * FPS


@draws
def test_films_are_written(tmp_path):
    import imageio.v3 as imageio

    semantics, played = episode("stack3", level="kinematic")
    short = [tick for tick in played.ticks if tick.command is not None][:1]
    cut = dataclasses.replace(played, ticks=tuple(short))
    told = []
    film(tmp_path / "film.gif", semantics, cut, progress=told.append)
    frames = imageio.imread(tmp_path / "film.gif")
    assert len(frames) > 12
    assert np.ptp(frames[0]) > 100
    assert np.abs(frames[0].astype(int) - frames[len(frames) // 2]).max() > 50
    assert told == sorted(told)
    assert told[-1] == 1
    assert (tmp_path / "film.gif").stat().st_size < 1e6


@draws
def test_the_solved_scene_is_drawn():
    import imageio.v3 as imageio

    semantics, played = episode("stack3", level="kinematic")
    picture = imageio.imread(final_picture(semantics.task, played, width=320, height=180))
    assert picture.shape == (180, 320, 3)
    yellow = (picture[..., 0] > 150) & (picture[..., 2] < 90)
    assert yellow.any()


@pytest.mark.parametrize("name", ["film.avi", "no_such_folder/film.mp4", "."])
def test_where_no_film_can_be_written(tmp_path, name):
    with pytest.raises(UserError, match="film"):
        check_film(tmp_path / name)


def test_without_a_renderer(monkeypatch, tmp_path):
    monkeypatch.setattr("bt_jax.mjx_env.render.film.available", lambda: "there is no EGL")
    semantics, played = episode("stack3", level="kinematic")
    assert final_picture(semantics.task, played) is None
    with pytest.raises(UserError, match="there is no EGL"):
        check_film(tmp_path / "film.gif")


def test_a_base_drives_with_the_gripper_and_what_it_holds():
    carried = "carry(YellowBox, (0, 0, 0.055), KittingBox)"
    semantics, played = played_tree("mobile_stack", carried, seed=1, level="kinematic")
    taken = shots(semantics, played, fps=FPS)
    bases, tips = np.array([shot.base for shot in taken]), np.array([shot.gripper.position for shot in taken])
    np.testing.assert_allclose(bases[0], played.start.base[0])
    np.testing.assert_allclose(bases[-1], played.final.base[0])
    driven = np.linalg.norm(np.diff(bases, axis=0), axis=1)
    assert 0 < driven.max() < 0.05
    assert driven.sum() == pytest.approx(played.travel, abs=1e-3)
    assert np.linalg.norm(tips[:, :2] - bases, axis=1).max() < semantics.task.robot.base.reach + 0.05
    yellow = np.array([shot.poses[0, :2] for shot in taken])
    carries = [i for i, shot in enumerate(taken) if "approach(KittingBox" in shot.caption]
    np.testing.assert_allclose(yellow[carries[-1]], bases[carries[-1]], atol=1e-3)


@draws
def test_a_base_is_drawn_where_it_stands():
    task = load_task("mobile_stack")
    world = sample_layouts(task, 0, 1)
    with Renderer(task, width=160, height=90, samples=0) as renderer:
        here, there = (renderer(world.kits[0], world.poses[0], base=np.array([x, 1.2])) for x in (-1.5, 1.5))
    changed = np.abs(here.astype(int) - there).sum(axis=(0, 2))
    assert changed[:80].any()
    assert changed[80:].any()
