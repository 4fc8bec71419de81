"""A person who teaches, without a browser."""

import asyncio
import dataclasses
import math

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.demonstration_library import ListedDemonstration
from bt_jax.app.state.directions import DIRECTIONS
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.lfd import Frames, plan_task
from bt_jax.lfd.evaluation.synthetic import demonstrate as shown
from bt_jax.lfd.questions import answered
from bt_jax.mjx_env.world import frames, to_world
from bt_jax.tasks import Target, load_task
from tests.helpers.asynchronous import in_loop

TASK = load_task("stack")


async def carry(studio, position, frame):
    """Presses the keys until the object in the gripper is at a position, to half a step."""
    teaching = studio.teaching
    where = frames(studio.teaching.session.world, TASK)
    index = np.array([TASK.frames.index(frame)])
    goal = to_world(where, index, np.asarray([position], np.float32))[0, 0]
    axes = {"right": TASK.right, "away": TASK.away, "up": (0.0, 0.0, 1.0)}
    for step in (0.1, 0.01, 0.001):
        teaching.set_step(step)
        for plus, minus in (("right", "left"), ("away", "near"), ("up", "down")):
            now = to_world(
                where, np.array([len(TASK.frames) - 1]), studio.teaching.session.position("base_link")[None]
            )[0, 0]
            away = float((goal - now) @ np.array(axes[plus]))
            for _ in range(round(abs(away) / step)):
                await teaching.move(plus if away > 0 else minus)


async def demonstrate(studio, *, reached=False):
    """GreenBox on YellowBox."""
    teaching = studio.teaching
    await teaching.begin(reached=reached)
    await teaching.pick("GreenBox")
    await carry(studio, (0.0, 0.0, 0.12), "YellowBox")
    await teaching.release()
    return await teaching.finish()


@in_loop
async def test_three_demonstrations_teach_a_tree(studio):
    seen = []
    studio.bus.subscribe("lesson", lambda: seen.append(studio.library.lesson))
    assert studio.library.progress == "The demonstrations are being read."
    await studio.library.refresh()
    said = [studio.library.progress]
    for number in (1, 2, 3):
        assert await demonstrate(studio) == f"demo{number}"
        said.append(studio.library.progress)
    assert said[0].startswith("No demonstration yet; 3 are needed")
    assert said[1].startswith("1 of 3 demonstrations: 2 more")
    assert said[2].startswith("2 of 3 demonstrations: 1 more")
    assert said[3].startswith("3 demonstrations: enough")
    assert studio.library.kept == tuple(ListedDemonstration(f"demo{number}", "GreenBox") for number in (1, 2, 3))
    assert studio.library.lesson is seen[-1]
    assert studio.library.lesson.missing == 0
    assert (studio.library.lesson.tree.name, studio.library.lesson.tree.frame) == ("move", "YellowBox")
    assert studio.library.lesson.tree.position == pytest.approx(
        (0, 0, 0.1), abs=2e-3
    )  # lowered, though it was let go above
    starts = {one.actions[0].poses["base_link"].position for one in studio.library.lesson.demonstrations}
    assert len(starts) == 3  # each in another layout


@in_loop
async def test_where_a_demonstration_begins(studio):
    teaching = studio.teaching
    with pytest.raises(UserError, match="no tree has been learnt yet; evolve one in step 2"):
        await teaching.begin(reached=True)
    teaching.elsewhere = False
    await teaching.begin(reached=False)
    np.testing.assert_array_equal(studio.teaching.session.world.poses, studio.edited.start.poses)
    studio.take_tree(plan_task(TASK), None)
    await teaching.begin(reached=True)
    yellow, green = studio.teaching.session.world.poses[0, :2, :3]
    np.testing.assert_allclose(green - yellow, (0, 0, 0.1), atol=1e-3)
    np.testing.assert_array_equal(studio.teaching.shown.poses, studio.teaching.session.world.poses)
    studio.take_tree(parse_tree("pick(GreenBox)"), None)
    with pytest.raises(UserError, match="ends with an object in the gripper"):
        await teaching.begin(reached=True)
    assert studio.teaching.session is not None


@in_loop
async def test_every_key_moves_as_the_person_sees_it(studio):
    teaching = studio.teaching
    await teaching.begin(reached=False)
    await teaching.pick("GreenBox")
    axes = {"right": TASK.right, "away": TASK.away, "up": (0.0, 0.0, 1.0)}
    opposite = {"left": "right", "near": "away", "down": "up"}
    teaching.set_step(0.03)
    for direction in DIRECTIONS:
        before = studio.teaching.session.position("base_link")
        await teaching.move(direction)
        sign = -1 if direction in opposite else 1
        expected = sign * 0.03 * np.array(axes[opposite.get(direction, direction)])
        np.testing.assert_allclose(studio.teaching.session.position("base_link") - before, expected, atol=1e-6)


@in_loop
async def test_an_object_is_carried_straight_over_another(studio):
    teaching = studio.teaching
    await teaching.begin(reached=False)
    with pytest.raises(UserError, match="holds nothing; pick an object first"):
        await teaching.carry_over("YellowBox")
    await teaching.pick("GreenBox")
    await teaching.move("up")
    for frame, height in (("YellowBox", 0.15), ("KittingBox", 0.15)):
        before = studio.teaching.session.world.poses[0, 1, 2]
        await teaching.carry_over(frame)
        np.testing.assert_allclose(studio.teaching.session.position(frame)[:2], 0, atol=1e-5)
        assert studio.teaching.session.position(frame)[2] >= height - 1e-5
        assert studio.teaching.session.world.poses[0, 1, 2] >= before - 1e-5
        assert teaching.landing.on == frame
    with pytest.raises(UserError, match="no frame 'GreenBox' to carry"):
        await teaching.carry_over("GreenBox")


@in_loop
async def test_an_object_is_turned_to_round_angles_and_carried_to_its_slot(studio):
    studio.open_task(load_task("kit4"))
    teaching = studio.teaching
    await teaching.begin(reached=False)
    with pytest.raises(UserError, match="holds nothing; pick an object first"):
        await teaching.turn(1)
    await teaching.pick("Plate")
    session, seen = teaching.session, []
    for way in (1, 1, -1):
        before = session.turn("base_link")
        await teaching.turn(way)
        seen.append(session.turn("base_link"))
        assert 0 < way * math.remainder(seen[-1] - before, 360) < 15.2
        assert abs(math.remainder(seen[-1], 15)) < 0.01
    assert seen[2] == pytest.approx(seen[0], abs=0.01)
    with pytest.raises(UserError, match="Plate does not go into the slot"):
        await teaching.carry_to_slot("Tray.can")
    await teaching.carry_to_slot("Tray.plate")
    assert teaching.landing.on == "Tray"
    again = teaching.draft.session(studio.worker.physics(session.task))
    np.testing.assert_allclose(again.world.poses, session.world.poses, atol=1e-5)
    await teaching.release()
    assert teaching.done == ["Pick up Plate", "Put Plate in slot plate of Tray"]
    await teaching.undo()
    await teaching.undo()  # the turns, too
    assert (session.held, teaching.done) == ("Plate", ["Pick up Plate"])


@in_loop
async def test_keys_are_carried_out_in_their_order(studio):
    """Pressed faster than they can be carried out."""
    teaching = studio.teaching
    await teaching.begin(reached=False)
    await asyncio.gather(teaching.pick("BlueBox"), *(teaching.move("up") for _ in range(3)), teaching.release())
    assert [action.kind for action in studio.teaching.session.actions] == ["pick", "place"]
    assert teaching.done[0] == "Pick up BlueBox"
    assert teaching.done[1].startswith("Put BlueBox ")


@in_loop
async def test_what_cannot_be_done_changes_nothing(studio, tmp_path):
    teaching = studio.teaching
    for call in (teaching.release, teaching.finish, teaching.undo, lambda: teaching.pick("GreenBox")):
        with pytest.raises(UserError, match="no demonstration is in the making; begin a new one"):
            await call()
    await teaching.begin(reached=False)
    with pytest.raises(UserError, match="nothing can be undone; pick an object"):
        await teaching.undo()
    await teaching.pick("GreenBox")
    with pytest.raises(UserError, match="still holds GreenBox; release it, then finish"):
        await teaching.finish()
    with pytest.raises(UserError, match="finish or discard it first"):
        await teaching.begin(reached=False)
    with pytest.raises(UserError, match="finish or discard it first"):
        await teaching.replay("demo1")
    await carry(studio, (0.0, 0.0, 0.04), "YellowBox")
    assert teaching.landing.inside == "YellowBox"
    with pytest.raises(UserError, match="would be inside YellowBox; raise it"):
        await teaching.release()
    await carry(studio, (0.5, 0.0, 0.9), "base_link")
    assert teaching.landing.on is None
    with pytest.raises(UserError, match="would fall to the floor"):
        await teaching.release()
    assert studio.teaching.session.held == "GreenBox"
    assert not studio.workspace.demonstrations.exists()
    await teaching.undo()
    await teaching.undo()
    assert teaching.done == []
    await teaching.discard()
    assert studio.teaching.session is None
    np.testing.assert_array_equal(studio.teaching.shown.poses, studio.edited.start.poses)


@pytest.mark.parametrize("step", [None, 0.0, 0.6, float("nan")])
def test_an_invalid_step_is_refused(studio, step):
    with pytest.raises(UserError, match=r"from 1 to 500 mm"):
        studio.teaching.set_step(step)


def test_steps_grow_and_shrink(studio):
    teaching = studio.teaching
    teaching.set_step(0.03)
    teaching.change_step(1)
    assert teaching.step == 0.05
    teaching.change_step(-1)
    assert teaching.step == 0.02
    for _ in range(20):
        teaching.change_step(-1)
    assert teaching.step == 0.001


@in_loop
async def test_the_list_is_kept(studio, tmp_path):
    for _ in range(2):
        await demonstrate(studio)
    await studio.library.rename("demo1", " over the top ")
    assert [one.name for one in studio.library.kept] == ["over the top", "demo2"]
    (studio.library.folder.path / "demo2" / "data_2.yaml").write_text("type: pla")
    await studio.library.refresh()
    good, bad = studio.library.kept
    assert good.problem == ""
    assert "demo2/data_2.yaml" in bad.problem
    assert studio.library.progress.startswith("1 of 3")
    await studio.library.delete("demo2")
    await studio.library.delete("over the top")
    assert studio.library.kept == ()
    assert studio.library.lesson is None
    assert studio.library.problem == ""
    with pytest.raises(UserError, match="the demonstration demo2 is no longer there"):
        await studio.library.delete("demo2")
    with pytest.raises(UserError, match="cannot name anything"):
        await studio.library.use_set("../elsewhere")
    assert studio.library.set_name == "demonstrations"


@in_loop
async def test_windows_hear_of_another_set_and_of_nothing_else(studio):
    heard = []
    studio.bus.subscribe("demonstrations", lambda: heard.append(studio.library.set_name))
    await studio.library.refresh()
    await studio.library.use_set("other")
    assert heard == ["demonstrations", "other", "other"]  # once to be read, and once read
    lesson = studio.library.lesson
    await asyncio.gather(studio.library.refresh(), studio.library.refresh())
    assert heard == ["demonstrations", "other", "other"]
    assert studio.library.lesson is lesson


@in_loop
async def test_a_demonstration_of_a_task_that_has_gone_does_not_begin(studio):
    beginning = asyncio.ensure_future(studio.teaching.begin(reached=False))
    await asyncio.sleep(0)
    studio.open_task(load_task("yumi_stack"))
    with pytest.raises(UserError, match="another task was chosen meanwhile"):
        await beginning
    assert studio.teaching.session is None


@in_loop
async def test_of_two_replays_the_last_is_shown_and_can_be_stopped(studio):
    await demonstrate(studio)
    await demonstrate(studio)
    await asyncio.gather(studio.teaching.replay("demo1"), studio.teaching.replay("demo2"))
    assert studio.teaching.replayed == "demo2"
    await asyncio.sleep(0.01)
    assert studio.bus.news.text.startswith("demo2")
    studio.teaching.stop_replay()
    await asyncio.sleep(0.01)
    others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    assert not any("_show_all" in repr(task) for task in others)


@in_loop
async def test_a_replay_shows_what_was_recorded(studio, monkeypatch):
    monkeypatch.setattr("bt_jax.app.state.teaching.PACE", 0.0)
    teaching = studio.teaching
    await teaching.begin(reached=False)
    first = studio.teaching.shown
    await teaching.pick("GreenBox")
    await carry(studio, (0.01, 0.0, 0.13), "YellowBox")
    await teaching.release()
    last = studio.teaching.shown
    await teaching.finish()
    studio.teaching.show(studio.edited.start)
    shown = []
    studio.bus.subscribe("scene", lambda: shown.append(studio.teaching.shown))
    await teaching.replay("demo1")
    await teaching._replay
    assert teaching.replayed is None
    for recorded, seen in ((first, shown[0]), (last, shown[-1])):
        np.testing.assert_allclose(seen.poses[..., :3], recorded.poses[..., :3], atol=1e-3)
        np.testing.assert_allclose(seen.kits, recorded.kits, atol=1e-4)
    assert [int(world.held[0]) for world in shown] == [-1, 1, 1, 1, -1]
    await teaching.replay("demo1")
    teaching.stop_replay()
    await asyncio.sleep(0)
    assert teaching.replayed is None
    with pytest.raises(UserError, match="demo9 cannot be replayed"):
        await teaching.replay("demo9")


@in_loop
async def test_after_a_frame_was_chosen_it_is_learnt_again(studio):
    with pytest.raises(UserError, match="nothing has been learnt yet"):
        await studio.library.choose_frame(1, "KittingBox")
    await demonstrate(studio)
    assert studio.library.lesson.tree.frame == "base_link"
    await studio.library.choose_frame(1, "YellowBox")
    assert studio.library.lesson.tree.frame == "YellowBox"
    assert studio.library.lesson.inferences[1].chosen
    with pytest.raises(UserError, match="cannot be in the frame"):
        await studio.library.choose_frame(1, "GreenBox")
    assert studio.library.lesson.tree.frame == "YellowBox"
    await studio.library.choose_frame(1, None)
    assert studio.library.lesson.tree.frame == "base_link"


@in_loop
async def test_another_task_says_why_nothing_is_learnt(studio):
    await demonstrate(studio)
    studio.open_task(load_task("yumi_stack"))
    await studio.library._refreshing
    assert studio.library.lesson is None
    assert "YellowBox measures 0.1 m in task stack and 0.04 m in yumi_stack" in studio.library.problem
    with pytest.raises(UserError, match="choose another folder"):
        await studio.teaching.begin(reached=False)


@in_loop
async def test_another_task_does_not_lose_a_demonstration(studio):
    before = studio.edited.task
    await studio.teaching.begin(reached=False)
    await studio.teaching.pick("GreenBox")
    with pytest.raises(UserError, match="in the making; finish or discard it in step 3 first"):
        studio.open_task(load_task("stack3"))
    assert studio.edited.task is before
    await studio.teaching.discard()
    studio.open_task(load_task("stack3"))
    await studio.library._refreshing


@in_loop
async def test_what_is_open_is_asked_answered_and_taken_back(studio):
    """The kit stood on one table each time: is the place in the kit, or a fixed one?"""
    library, folder = studio.library, studio.library.folder
    layout = dataclasses.replace(TASK.layout, kit=TASK.tables[0].name)
    folder.create(Frames.of(TASK))
    place = Target("GreenBox", (0.0, 0.0, 0.0525), "KittingBox")
    for number in range(3):
        folder.append(
            shown(dataclasses.replace(TASK, layout=layout), [place], rng=np.random.default_rng(number), noise=0.002)
        )
    await library.refresh()
    assert library.asked is None
    await library.ask()
    (question,) = library.asked.questions
    assert [answer.value for answer in question.answers] == ["KittingBox", "base_link"]
    proposal = await library.propose()
    await studio.teaching.begin(reached=False, start=proposal.start)
    np.testing.assert_array_equal(studio.teaching.session.world.kits, proposal.start.kits)
    await studio.teaching.discard()
    before = library.lesson
    await library.answer(question.answers[1])
    assert library.lesson.tree == question.answers[1].lesson.tree != before.tree
    assert library.asked is None  # until it is asked for again
    await library.ask()
    assert library.asked.questions == ()
    (said,) = answered(library.lesson)
    await library.take_back(said)
    assert library.lesson == before
    with pytest.raises(UserError, match="leave nothing open"):
        await library.propose()
