"""A person who takes an object with the mouse, carries it and drops it: one input of the demonstration in the making."""

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.extents import heading, poses_now
from bt_jax.app.state.studio import Studio
from bt_jax.lfd import Demonstrations, Frames, learn
from bt_jax.tasks import load_task
from tests.helpers.asynchronous import in_loop

TASK = load_task("stack")


def above(studio, name, height=0.1):
    """A place over the middle of an object."""
    return np.add(poses_now(studio.edited.task, studio.teaching.session.world)[name][:3], (0, 0, height))


@in_loop
async def test_a_drag_is_what_the_keys_do_and_is_undone_at_once(studio):
    teaching = studio.teaching
    await teaching.begin(reached=False)
    start = teaching.session.world
    goal = above(studio, "YellowBox")
    assert await teaching.drag("GreenBox", goal, 0.0) == ""
    by_mouse = teaching.session
    assert teaching.done == ["Pick up GreenBox", "Put GreenBox on top of YellowBox"]
    await teaching.undo()
    assert teaching.done == []
    np.testing.assert_array_equal(teaching.session.world.poses, start.poses)
    await teaching.pick("GreenBox")
    await teaching.carry_over("YellowBox")
    await teaching.release()
    np.testing.assert_allclose(teaching.session.world.poses, by_mouse.world.poses, atol=1e-4)


@in_loop
async def test_what_is_in_the_gripper_is_dragged_on_and_undone_to_where_it_was(studio):
    teaching = studio.teaching
    await teaching.begin(reached=False)
    await teaching.pick("GreenBox")
    await teaching.move("up")
    before = teaching.session.world
    with pytest.raises(UserError, match="the gripper holds GreenBox; release it"):
        await teaching.drag("BlueBox", above(studio, "YellowBox"), 0.0)
    await teaching.drag("GreenBox", above(studio, "YellowBox"), 90.0)
    assert teaching.session.held is None
    await teaching.undo()
    assert teaching.session.held == "GreenBox"
    np.testing.assert_array_equal(teaching.session.world.poses, before.poses)


@in_loop
async def test_a_drop_where_it_cannot_be_changes_nothing(studio):
    teaching = studio.teaching
    await teaching.begin(reached=False)
    start, draft = teaching.session.world, teaching.draft
    for place, why in ((above(studio, "YellowBox", 0.02), "inside YellowBox"), (np.array([0.6, 0.0, 0.8]), "floor")):
        with pytest.raises(UserError, match=why):
            await teaching.drag("GreenBox", place, 0.0)
        assert teaching.session.world is start
        assert teaching.draft is draft
    with pytest.raises(UserError, match="nothing can be undone"):
        await teaching.undo()


@in_loop
async def test_an_object_is_turned_on_the_way_and_caught_by_a_slot(studio):
    studio.open_task(load_task("kit4"))
    teaching = studio.teaching
    await teaching.begin(reached=False)
    task, world = teaching.session.task, teaching.session.world
    lay = heading(poses_now(task, world)["Plate"])
    place = poses_now(task, world)["Plate"][:3]
    await teaching.drag("Plate", place, 30.0)
    assert heading(poses_now(task, teaching.session.world)["Plate"]) == pytest.approx(lay + 30, abs=0.1)
    slot = next(slot for slot in task.kits[0].places if slot.name == "plate")
    near = world.kits[0, 0] + [*slot.position, task.kits[0].plate + task.thing("Plate").height / 2] + [0.003, 0, 0]
    assert await teaching.drag("Plate", near, 0.0) == "slot plate of Tray"
    assert teaching.done[-1] == "Put Plate in slot plate of Tray"


@in_loop
async def test_a_drag_outlives_a_killed_page(studio):
    await studio.teaching.begin(reached=False)
    await studio.teaching.drag("GreenBox", above(studio, "YellowBox"), 45.0)
    await studio.drafts.kept()
    after = Studio(studio.workspace, TASK)
    after.restore()
    assert after.teaching.done == studio.teaching.done
    np.testing.assert_allclose(after.teaching.session.world.poses, studio.teaching.session.world.poses, atol=1e-5)
    await after.teaching.undo()
    assert after.teaching.done == []


@in_loop
async def test_demonstrations_by_mouse_teach_as_those_by_keys_do(studio):
    teaching, shown = studio.teaching, []
    for _ in range(3):
        await teaching.begin(reached=False)
        await teaching.drag("GreenBox", above(studio, "YellowBox"), 0.0)
        shown.append(teaching.session.demonstration())
        await teaching.discard()
    tree = learn(Demonstrations(Frames.of(TASK), tuple(shown)), TASK).tree
    assert (tree.name, tree.object, tree.frame) == ("move", "GreenBox", "YellowBox")
    assert tree.position == pytest.approx((0, 0, 0.1), abs=2e-3)
