import itertools

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.player import Player
from bt_jax.behaviors import Vocabulary, expand
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.faults.fates import sample_episodes
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_faults, load_task, with_faults

TASK = load_task("stack")
PHYSICS = MujocoPhysics(TASK, threads=1)
START = sample_layouts(TASK, 0, 1)
TREE = parse_tree("""
Sequence
  move(YellowBox, (0, 0, 0.055), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
""")


@pytest.fixture
def player():
    return Player(TASK, PHYSICS, TREE, START)


def run(player, most=40):
    for _ in range(most):
        if player.ending != Ending.OPEN:
            return
        player.tick()
    raise AssertionError("the episode does not end")


def at(player, name):
    return player.world.poses[0, TASK.object_names.index(name), :3].astype(float)


def test_it_plays_what_play_plays(player):
    run(player)
    written = expand(TREE)
    semantics = LeafSemantics(TASK, Vocabulary.of(leaves(written)))
    expected = play(semantics, Settler(TASK, PHYSICS), written, START)
    assert player.ending == expected.ending == Ending.SUCCESS
    assert [snapshot.tick.command for snapshot in player.snapshots[1:]] == [tick.command for tick in expected.ticks]
    assert [snapshot.tick.statuses for snapshot in player.snapshots[1:]] == [tick.statuses for tick in expected.ticks]
    np.testing.assert_array_equal(player.world.poses, expected.final.poses)
    assert player.in_place == tuple(expected.misses.met.ravel()) == (True, True)


def test_statuses_have_the_ids_of_the_drawing(player):
    assert set(player.statuses.values()) == {None}
    player.tick()
    assert player.statuses["node-0"] == player.statuses["node-1"] == Status.RUNNING
    assert player.statuses["node-2"] is None
    assert player.statuses["node-1-1"] == Status.FAILURE  # it is not there yet
    run(player)
    assert {player.statuses[name] for name in ("node-0", "node-1", "node-2")} == {Status.SUCCESS}


def test_stepping_back_and_forth_repeats_what_was_seen(player):
    run(player)
    last = len(player.snapshots) - 1
    assert player.seek(-3) is player.snapshots[0]
    np.testing.assert_array_equal(player.world.poses, START.poses)
    assert player.tick() is player.snapshots[1]
    assert player.seek(99) is player.snapshots[last]
    assert player.tick() is player.snapshots[last]
    assert len(player.snapshots) == last + 1


def test_the_motion_is_continuous_and_ends_in_the_state(player):
    run(player)
    taken = [shot for snapshot in player.snapshots for shot in snapshot.shots]
    for before, after in itertools.pairwise(taken):
        assert np.abs(np.subtract(after.gripper.position, before.gripper.position)).max() < 0.18
        assert np.abs(after.poses[:, :3] - before.poses[:, :3]).max() < 0.2
    for snapshot in player.snapshots:
        np.testing.assert_allclose(snapshot.shots[-1].poses, snapshot.episode.world.poses[0], atol=1e-6)
        assert 0.3 < snapshot.seconds < 6


def test_the_tree_reacts_to_a_box_that_a_person_moves(player):
    run(player)
    ticks = len(player.snapshots)
    player.put("GreenBox", START.poses[0, 1, :3].astype(float))
    assert player.ending == Ending.OPEN
    assert player.now.moved == "GreenBox"
    assert player.in_place == (True, False)
    run(player)
    assert player.ending == Ending.SUCCESS
    assert all(player.in_place)
    commands = [str(m.tick.command).split("(")[0] for m in player.snapshots[ticks + 1 :] if m.tick.command]
    assert commands == ["pick", "place"]


def test_the_future_is_forgotten_when_a_box_is_moved_in_the_past(player):
    run(player)
    player.seek(2)
    kit = START.kits[0, 0].astype(float)
    player.put("BlueBox", kit + np.array([0.12, 0.12, 0.055]))
    assert len(player.snapshots) == player.at + 1 == 4
    run(player)
    assert player.ending == Ending.SUCCESS
    assert np.linalg.norm(at(player, "BlueBox") - kit) < 0.2


def test_what_cannot_be_put_changes_nothing(player):
    player.tick()
    before = list(player.snapshots)
    with pytest.raises(UserError, match="in the gripper"):
        player.put("YellowBox", at(player, "YellowBox"))
    with pytest.raises(UserError, match="no table there"):
        player.put("BlueBox", np.array([0.0, 3.0, 1.0]))
    assert player.snapshots == before
    assert player.at == 1


def test_a_tree_of_another_task_is_refused():
    with pytest.raises(UserError, match="RedBox"):
        Player(TASK, PHYSICS, parse_tree("pick(RedBox)"), START)


def test_what_goes_wrong_goes_wrong_here_too():
    task = with_faults(TASK, load_faults("harsh"), source="harsh")
    layouts, fates = sample_episodes(task, [3, 0], layouts=1, draws=8)
    written = expand(TREE)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(written)))
    struck = 0
    for k in range(8):
        start, fate = take(layouts, slice(k, k + 1)), fates[slice(k, k + 1)]
        player = Player(task, PHYSICS, TREE, start, fate)
        run(player)
        expected = play(semantics, Settler(task, PHYSICS), written, start, fate)
        assert player.ending == expected.ending
        assert [one.tick.troubles for one in player.snapshots[1:]] == [tick.troubles for tick in expected.ticks]
        for snapshot in player.snapshots:  # the scene shows what a person has moved after a tick
            np.testing.assert_allclose(
                snapshot.shots[-1].poses[:, :3], snapshot.episode.world.poses[0, :, :3], atol=1e-6
            )
        struck += any(tick.troubles for tick in expected.ticks)
    assert struck
