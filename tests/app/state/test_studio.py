"""What happens to several parts of the state at once."""

import asyncio
import dataclasses

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.plain_words import differing_settings
from bt_jax.app.state.kit.new import new_kit
from bt_jax.app.state.kit.objects import add_object
from bt_jax.app.state.retargeting import untarget
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.faults.fates import sample_episodes
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.tasks import Object, Subgoal, load_faults, load_task, with_faults
from bt_jax.training.phases import Changes
from bt_jax.training.run_folder import RunConfig, RunFolder
from bt_jax.training.settings import UNSEEN
from bt_jax.training.training import Settings

TREE = parse_tree("move(YellowBox, (0, 0, 0.055), KittingBox)")
STACK3 = load_task("stack3")


@pytest.fixture
def studio(tmp_path, monkeypatch):
    monkeypatch.setattr("bt_jax.app.state.worker.MujocoPhysics", lambda task, **_: Kinematic(task))
    studio = Studio(Workspace(tmp_path), STACK3)
    studio.take_tree(TREE, "run")
    return studio


def noticed(studio):
    return " ".join(notice.text for notice in studio.notices.standing)


def other_boxes(task):
    boxes = (*task.objects, Object("Cup", (0.05, 0.05, 0.05), (1.0, 0.0, 0.0)))
    return dataclasses.replace(task, name="cups", objects=boxes)


def test_a_tree_stays_as_long_as_there_are_the_same_things(studio):
    studio.open_task(load_task("pyramid"))
    assert (studio.playing.run, studio.playing.tree) == ("run", TREE)
    studio.open_task(other_boxes(studio.edited.task))
    assert (studio.playing.run, studio.playing.tree) == (None, None)


def test_all_subscribers_see_a_complete_change(studio):
    seen = []
    for topic in ("task", "scene", "player"):
        studio.bus.subscribe(
            topic, lambda: seen.append(studio.edited.start.poses.shape[1] == len(studio.edited.task.objects))
        )
    studio.open_task(other_boxes(studio.edited.task))
    studio.edit_task(untarget(studio.edited.task, "BlueBox"))
    assert seen
    assert all(seen)


def test_edits_are_undone_and_redone(studio):
    fewer = untarget(STACK3, "BlueBox")
    studio.edit_task(fewer)
    moved = dataclasses.replace(studio.edited.start, poses=studio.edited.start.poses + np.float32(0.01))
    studio.edit_task(fewer, moved)
    studio.undo_edit()
    assert studio.edited.task == fewer
    np.testing.assert_array_equal(studio.teaching.shown.poses, studio.edited.start.poses)
    assert not np.array_equal(studio.edited.start.poses, moved.poses)
    studio.undo_edit()
    assert studio.edited.task == STACK3
    assert not studio.edited.can_undo
    with pytest.raises(UserError, match="nothing to undo"):
        studio.undo_edit()
    studio.redo_edit()
    studio.redo_edit()
    np.testing.assert_array_equal(studio.edited.start.poses, moved.poses)
    studio.revert_task()
    assert studio.edited.saved
    studio.undo_edit()
    assert studio.edited.task == fewer


def test_a_kit_is_built_undone_and_evolved_only_once_it_can_work(studio):
    studio.open_task(new_kit([]))
    studio.build(add_object(studio.edited.task, "cuboid")[0])
    assert studio.edited.task.object_names == ("BoxA", "BoxB")
    assert studio.edited.start.poses.shape[1] == studio.teaching.shown.poses.shape[1] == 2
    assert studio.workspace.draft() == studio.edited.task
    with pytest.raises(UserError, match="see step 1: Nothing has to be anywhere yet"):
        studio.start_evolution(GPConfig())
    studio.undo_edit()
    assert studio.edited.start.poses.shape[1] == len(studio.edited.task.objects) == 1
    studio.redo_edit()
    assert studio.edited.task.object_names == ("BoxA", "BoxB")


def test_a_task_with_other_boxes_has_a_history_of_its_own(studio):
    studio.edit_task(untarget(STACK3, "BlueBox"))
    studio.open_task(load_task("yumi_stack"))
    assert not studio.edited.can_undo


def test_unsaved_changes_are_restored_by_the_next_page(studio):
    fewer = untarget(STACK3, "BlueBox")
    studio.edit_task(fewer)
    assert studio.unsaved
    after = Studio(studio.workspace, load_task("stack"))
    after.restore()
    assert after.edited.task == fewer
    assert "Your unsaved changes of stack3 were restored" in noticed(after)
    after.undo_edit() if after.edited.can_undo else after.revert_task()
    assert after.edited.task == STACK3
    again = Studio(studio.workspace, load_task("stack"))
    again.restore()
    assert (again.edited.task, noticed(again)) == (load_task("stack"), "")


def test_restored_changes_are_discarded_by_their_notice_until_somebody_goes_on_with_them(studio):
    studio.edit_task(untarget(STACK3, "BlueBox"))
    for edit in (True, False):
        after = Studio(studio.workspace, load_task("stack"))
        after.restore()
        (notice,) = after.notices.standing
        assert notice.discard.steers == "task"
        assert notice.discard.question == "Discard the unsaved changes of stack3?"
        if edit:
            after.edit_task(untarget(after.edited.task, "GreenBox"))
        else:
            notice.discard.do()
            assert after.edited.task == STACK3
            assert studio.workspace.draft() is None
        assert after.notices.standing == ()


def test_restored_changes_of_a_task_whose_file_has_gone_can_be_discarded(studio):
    studio.save_task("mine")
    studio.edit_task(untarget(studio.edited.task, "BlueBox"))
    (studio.workspace.tasks / "mine.yaml").unlink()
    after = Studio(studio.workspace, load_task("stack"))
    after.restore()
    assert after.edited.task.name == "mine"
    after.notices.standing[0].discard.do()
    assert after.edited.task == load_task(studio.workspace.task_names()[0])
    assert (after.notices.standing, studio.workspace.draft()) == ((), None)


def test_an_edit_counts_though_its_draft_cannot_be_written(studio, monkeypatch):
    def fail(path, content):
        raise UserError("the disk is full")

    seen = []
    studio.bus.subscribe("task", lambda: seen.append(studio.edited.task))
    monkeypatch.setattr("bt_jax.app.state.workspace.write_atomic", fail)
    fewer = untarget(STACK3, "BlueBox")
    with pytest.raises(UserError, match="full"):
        studio.edit_task(fewer)
    assert seen == [fewer]


def test_what_was_saved_leaves_no_draft(studio):
    studio.edit_task(untarget(STACK3, "BlueBox"))
    studio.workspace.save_task("mine", studio.edited.task)
    studio.edit_task(studio.workspace.task("mine"))
    assert not studio.unsaved
    assert studio.workspace.draft() is None


def run_of(studio, name, task):
    return RunFolder.create(studio.workspace.runs / name, RunConfig(task, GPConfig(), Settings()))


@pytest.mark.parametrize("with_run", [False, True])
@pytest.mark.parametrize("text", ["targets: [", "later_version: 3"])
def test_a_draft_that_cannot_be_read_is_kept_under_another_name(studio, tmp_path, with_run, text):
    if with_run:
        run_of(studio, "run", STACK3)
    for name in ("draft.yaml.unreadable", "draft.yaml.unreadable-2"):
        (tmp_path / "draft.yaml").write_text(text)
        studio.restore()
        assert "draft of your task cannot be restored" in noticed(studio)
        assert f"It is kept as {name}." in noticed(studio)
        assert studio.edited.task == STACK3
        studio.edit_task(untarget(STACK3, "BlueBox"))
        assert (tmp_path / name).read_text() == text
        studio.undo_edit()


def test_restoring_leaves_the_draft_and_needs_no_room_on_the_disk(studio, tmp_path, monkeypatch):
    def fail(*_):
        raise UserError("the disk is full")

    run_of(studio, "run", STACK3)
    fewer = untarget(STACK3, "BlueBox")
    studio.edit_task(fewer)
    text = (tmp_path / "draft.yaml").read_text()
    after = Studio(studio.workspace, load_task("stack"))
    for name in ("save_draft", "delete_draft"):
        monkeypatch.setattr(Workspace, name, fail)
    after.restore()
    assert (after.playing.run, after.edited.task) == ("run", fewer)
    assert (tmp_path / "draft.yaml").read_text() == text


def test_a_draft_that_cannot_be_renamed_hinders_nothing(studio, tmp_path, monkeypatch):
    def fail(*_):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "draft.yaml").write_text("targets: [")
    monkeypatch.setattr("pathlib.Path.rename", fail)
    studio.restore()
    assert "copy it before you change the task" in noticed(studio)
    assert (tmp_path / "draft.yaml").is_file()


@pytest.mark.parametrize("leave", ["delete", "other tree", "other run"])
def test_a_task_that_only_a_run_holds_outlives_it(studio, monkeypatch, leave):
    fewer = untarget(STACK3, "BlueBox")
    run_of(studio, "only", fewer)
    studio.open_run("only")
    assert not studio.unsaved
    assert studio.workspace.draft() is None
    if leave == "delete":
        asyncio.run(studio.delete_run("only"))
    elif leave == "other tree":
        studio.take_tree(TREE, None)
    else:
        monkeypatch.setattr(studio.evolution, "start", lambda task, gp, begin: setattr(studio.evolution, "run", "new"))
        studio.start_evolution(GPConfig())
    assert studio.unsaved
    after = Studio(studio.workspace, STACK3)
    after.restore()
    assert after.edited.task == fewer


def test_a_run_stays_if_its_task_cannot_be_kept(studio, monkeypatch):
    def fail(*_):
        raise UserError("the disk is full")

    run_of(studio, "only", untarget(STACK3, "BlueBox"))
    studio.open_run("only")
    monkeypatch.setattr("bt_jax.app.state.workspace.write_atomic", fail)
    with pytest.raises(UserError, match="full"):
        asyncio.run(studio.delete_run("only"))
    assert studio.workspace.run_names() == ["only"]


def test_a_failing_draft_does_not_hinder_the_watch(evolved, monkeypatch):
    def fail(*_):
        raise UserError("the disk is full")

    evolved.edit_task(untarget(STACK3, "BlueBox"))
    seen = []
    evolved.bus.subscribe("evolution", lambda: seen.append(evolved.evolution.stage))
    monkeypatch.setattr("bt_jax.app.state.workspace.write_atomic", fail)
    evolving(evolved.evolution, monkeypatch, taught=STACK3)
    evolved.watch()
    assert (seen, evolved.bus.news.text) == (["evolving"], "the disk is full")


@pytest.fixture
def evolved(studio, monkeypatch):
    """A studio with a run of the task, opened; a request to go on ends at its process."""
    run_of(studio, "run", STACK3)
    studio.open_run("run")
    requests = []
    monkeypatch.setattr(studio.evolution, "go_on", lambda generations, changes: requests.append(changes))
    studio.requests = requests
    return studio


def test_the_task_of_an_evolution_is_not_the_one_that_is_edited(evolved):
    assert evolved.in_step
    fewer = untarget(STACK3, "BlueBox")
    evolved.edit_task(fewer)
    assert not evolved.in_step
    assert (evolved.evolution.task, evolved.edited.task) == (STACK3, fewer)
    evolved.go_on(10)
    evolved.go_on(10, Changes(task=evolved.edited.task))
    assert [changes.task for changes in evolved.requests] == [None, fewer]
    config = evolved.workspace.run("run").config()
    assert Changes(task=fewer).applied(config).task == fewer
    with pytest.raises(UserError, match="other values for objects"):
        Changes(task=load_task("yumi_stack")).applied(config)


def evolving(evolution, monkeypatch, *, taught):
    """The process of an evolution begins, and works for the task `taught`."""

    def poll():
        evolution.stage, evolution.task = "evolving", taught
        return True

    evolution.stage = "starting"
    monkeypatch.setattr(evolution, "poll", poll)


@pytest.mark.parametrize("edited", ["in step", "out of step", "changed meanwhile"])
def test_what_an_evolution_was_taught_becomes_an_edit_unless_a_person_wants_something_else(
    evolved, monkeypatch, edited
):
    fewer = untarget(STACK3, "BlueBox")
    if edited == "out of step":
        evolved.edit_task(fewer)
    evolved.go_on(10)
    if edited == "changed meanwhile":
        evolved.edit_task(fewer)
    taught = dataclasses.replace(STACK3, targets=load_task("pyramid").targets)
    evolving(evolved.evolution, monkeypatch, taught=taught)
    evolved.watch()
    assert evolved.edited.task == (taught if edited == "in step" else fewer)
    evolved.undo_edit()
    assert evolved.edited.task == STACK3


def test_work_is_done_one_after_the_other(studio):
    done = []

    async def check():
        await asyncio.gather(*(studio.worker.work(done.append, i) for i in range(20)))

    asyncio.run(check())
    assert done == list(range(20))


def test_a_demonstration_in_the_making_stays_where_it_is(studio):
    async def check():
        await studio.teaching.begin(reached=False)
        before = studio.teaching.shown
        studio.edit_task(untarget(studio.edited.task, "BlueBox"), studio.edited.start)
        np.testing.assert_array_equal(studio.teaching.shown.poses, before.poses)
        assert studio.teaching.session is not None

    asyncio.run(check())


def test_two_tasks_that_differ_are_asked_about_until_one_changes(evolved):
    assert not evolved.asks_for_goal
    reordered = dataclasses.replace(STACK3, targets=STACK3.targets[::-1])
    evolved.edit_task(reordered)
    assert not evolved.asks_for_goal
    fewer = untarget(STACK3, "BlueBox")
    evolved.edit_task(fewer)
    assert evolved.asks_for_goal
    evolved.keep_both()
    assert not evolved.asks_for_goal
    evolved.edit_task(untarget(fewer, "GreenBox"))
    assert evolved.asks_for_goal
    evolved.take_goal(evolved.evolution.task)
    assert (evolved.edited.task, evolved.asks_for_goal) == (STACK3, False)
    evolved.undo_edit()
    assert evolved.edited.task == untarget(fewer, "GreenBox")


@pytest.mark.parametrize(
    "changes",
    [
        {"weights": dataclasses.replace(STACK3.weights, node=99.0)},
        {"episode": dataclasses.replace(STACK3.episode, max_ticks=99)},
        {"genes": dataclasses.replace(STACK3.genes, gap=0.03)},
        {"subgoal_reward": "seen"},
        {"subgoals": (Subgoal("free", ("clear(YellowBox)",)),)},
        {"robot_position": (0.0, 1.1, 0.05)},
        {"gripper_opening": 0.3},
        {"kits": (dataclasses.replace(STACK3.kits[0], size=(0.5, 0.5)),)},
        {"tables": (dataclasses.replace(STACK3.tables[0], size=(1.1, 1.1, 0.05)), *STACK3.tables[1:])},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_whatever_differs_between_two_tasks_is_asked_about(evolved, changes):
    evolved.open_task(dataclasses.replace(STACK3, name="mine", description="Mine."))
    assert not evolved.asks_for_goal
    evolved.open_task(dataclasses.replace(STACK3, name="mine", **changes))
    assert evolved.asks_for_goal
    (said,) = differing_settings(evolved.edited.task, STACK3)
    assert said
    evolved.take_goal(evolved.evolution.task)
    assert (evolved.edited.task.name, evolved.asks_for_goal) == ("mine", False)


def test_a_task_file_that_somebody_else_has_changed_is_known(studio):
    studio.save_task("mine")
    assert (studio.edited.task.name, studio.edited.changed_on_disk) == ("mine", False)
    studio.edit_task(untarget(studio.edited.task, "BlueBox"))
    assert not studio.edited.changed_on_disk
    path = studio.workspace.tasks / "mine.yaml"
    path.write_text(path.read_text() + "# theirs\n")
    assert studio.edited.changed_on_disk
    studio.save_task("mine")
    assert not studio.edited.changed_on_disk


@pytest.mark.parametrize("faults", [None, "harsh"])
def test_a_start_of_the_test_of_a_run_is_played_as_it_was_tested(studio, faults):
    task = STACK3 if faults is None else with_faults(STACK3, load_faults(faults), source=faults)
    config = RunConfig(task, GPConfig(seed=7), Settings(test_layouts=4))
    RunFolder.create(studio.workspace.runs / "run", config).save_tree(TREE, title="")
    asyncio.run(studio.replay("run", 3, 2))
    layouts, fates = sample_episodes(task, [UNSEEN, 7], layouts=4, draws=2)
    row, player = (2 if faults is None else 2 * 2 + 1), studio.playing.player
    np.testing.assert_array_equal(player.world.poses[0], layouts.poses[row])
    assert (studio.edited.task, studio.playing.run, studio.playing.tree) == (task, "run", TREE)
    assert (player.fate is None) == (faults is None)
    if fates is not None:
        np.testing.assert_array_equal(player.fate.variant[0], fates.variant[row])
    with pytest.raises(UserError, match="there is no layout 5 in the test; choose 1 to 4"):
        asyncio.run(studio.replay("run", 5, 1))
