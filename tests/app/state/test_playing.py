import asyncio

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.tasks import load_task

TREE = parse_tree("""
Sequence
  move(YellowBox, (0, 0, 0.055), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
""")


@pytest.fixture
def studio(tmp_path):
    studio = Studio(Workspace(tmp_path), load_task("stack"))
    studio.take_tree(TREE, None)
    studio.playing.speed = 100.0
    studio.cues = []
    studio.bus.subscribe("player", lambda: studio.cues.append(studio.playing.cue))
    return studio


async def until(condition):
    for _ in range(6000):
        if condition():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("it does not happen")


def kinds(studio):
    """The cues in their order, each once."""
    return [cue.kind for cue in dict.fromkeys(studio.cues)]


async def begun(studio):
    await studio.playing.begin()
    studio.playing.play()


def test_it_plays_to_the_end(studio):
    async def check():
        await begun(studio)
        assert studio.playing.on
        await until(lambda: not studio.playing.on)
        assert studio.playing.player.ending == Ending.SUCCESS
        assert kinds(studio) == ["show", *["play"] * 5, "show"]  # four actions, back home, and once more to be sure
        studio.playing.play()  # again from the beginning
        assert studio.playing.player.at == 0
        await until(lambda: not studio.playing.on)
        assert studio.playing.player.at == len(studio.playing.player.snapshots) - 1

    asyncio.run(check())


def test_pause_holds_still_and_play_goes_on(studio):
    async def check():
        studio.playing.speed = 0.5
        await begun(studio)
        await until(lambda: studio.playing.cue.kind == "play")
        at = studio.playing.player.at
        studio.playing.pause()
        assert studio.playing.cue.kind == "freeze"
        await asyncio.sleep(0.05)
        assert studio.playing.player.at == at
        studio.playing.play()
        assert studio.playing.cue.kind == "go on"
        studio.playing.pause()
        studio.playing.speed = 100.0
        await studio.playing.tick()
        assert studio.playing.player.at == at + 1
        assert not studio.playing.on
        await studio.playing.seek(0)
        assert (studio.playing.player.at, studio.playing.cue.kind) == (0, "show")

    asyncio.run(check())


def test_play_and_pause_many_times_never_play_twice(studio):
    async def check():
        await studio.playing.begin()
        for _ in range(30):
            studio.playing.play()
            await asyncio.sleep(0.001)
            studio.playing.pause()
        studio.playing.play()
        await until(lambda: not studio.playing.on)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.wait(others, timeout=10) if others else None
        assert studio.playing.player.ending == Ending.SUCCESS
        assert not [task for task in others if not task.done()]

    asyncio.run(check())


def test_a_box_that_is_moved_while_it_runs_is_put_back(studio):
    async def check():
        await begun(studio)
        await until(lambda: not studio.playing.on)
        table = studio.edited.start.poses[0, 1, :3].astype(float)
        await studio.playing.put("GreenBox", lambda world: table)
        assert studio.playing.on  # since it had not been paused
        await until(lambda: not studio.playing.on)
        assert studio.playing.player.ending == Ending.SUCCESS
        assert all(studio.playing.player.in_place)

    asyncio.run(check())


def test_a_box_that_is_moved_in_a_pause_waits_for_play(studio):
    async def check():
        await studio.playing.begin()
        await studio.playing.tick()
        await studio.playing.put("BlueBox", lambda world: world.kits[0, 0] + np.array([0.1, 0.1, 0.06]))
        assert not studio.playing.on
        with pytest.raises(UserError, match="in the gripper"):
            await studio.playing.put("YellowBox", lambda world: world.kits[0, 0] + np.array([-0.1, -0.1, 0.06]))
        assert studio.playing.cue.kind == "show"

    asyncio.run(check())


def test_play_is_not_undone_by_an_episode_that_was_being_made(studio):
    async def check():
        await studio.playing.begin()
        beginning = asyncio.ensure_future(studio.playing.begin())
        await asyncio.sleep(0)
        old = studio.playing.player
        studio.playing.play()
        await beginning
        assert studio.playing.player is not old
        assert studio.playing.on
        await until(lambda: not studio.playing.on)
        assert studio.playing.player.ending == Ending.SUCCESS

    asyncio.run(check())


def test_a_tick_is_one_of_the_episode_that_is_being_made(studio):
    async def check():
        await asyncio.gather(studio.playing.begin(), studio.playing.begin(again=False))
        first = studio.playing.player
        await asyncio.gather(studio.playing.begin(), studio.playing.tick())
        assert studio.playing.player is not first
        assert studio.playing.player.at == 1

    asyncio.run(check())


def test_a_box_goes_to_a_place_in_what_there_is_then(studio):
    """Beside GreenBox, which the robot has carried elsewhere meanwhile."""

    async def check():
        await begun(studio)
        await until(lambda: not studio.playing.on)
        index = studio.edited.task.object_names.index("GreenBox")
        await studio.playing.put("BlueBox", lambda world: world.poses[0, index, :3] + np.array([0, 0, 0.1]))
        blue = studio.playing.player.world.poses[0, studio.edited.task.object_names.index("BlueBox"), :2]
        np.testing.assert_allclose(blue, studio.edited.start.kits[0, 0, :2], atol=0.03)

    asyncio.run(check())


def test_another_tree_ends_what_runs(studio):
    async def check():
        await begun(studio)
        other = parse_tree("move(YellowBox, (0, 0, 0.055), KittingBox)")
        studio.take_tree(other, None)
        assert (studio.playing.tree, studio.playing.player) == (other, None)
        await until(lambda: not studio.playing.on)
        await studio.playing.begin(again=False)
        assert studio.playing.player.tree == other

    asyncio.run(check())


def test_another_task_ends_it(studio):
    async def check():
        await begun(studio)
        studio.open_task(load_task("pyramid"))
        await until(lambda: not studio.playing.on)
        with pytest.raises(UserError, match="choose a tree"):
            await studio.playing.tick()

    asyncio.run(check())


def test_a_player_of_the_task_before_never_comes_late(studio):
    async def check():
        beginning = asyncio.ensure_future(studio.playing.begin())
        await asyncio.sleep(0)
        studio.open_task(load_task("pyramid"))
        await beginning
        assert studio.playing.player is None
        await studio.playing.begin()
        old, ticking = studio.playing.player, asyncio.ensure_future(studio.playing.tick())
        await asyncio.sleep(0)
        studio.open_task(load_task("stack"))
        cue = studio.playing.cue
        await ticking
        assert studio.playing.cue is cue
        assert studio.playing.player is not old

    asyncio.run(check())


def test_without_a_tree(studio):
    studio.take_tree(None, None)
    with pytest.raises(UserError, match="no tree to run"):
        asyncio.run(studio.playing.begin())
    studio.take_tree(parse_tree("pick(RedBox)"), None)
    with pytest.raises(UserError, match="RedBox"):
        asyncio.run(studio.playing.begin())
    assert studio.playing.player is None
