"""The tree that a person corrects: what runs, what is tried, and where evolution goes on."""

import asyncio

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes.tree_trial import STARTS
from bt_jax.app.state import edited_tree
from bt_jax.app.state.edited_tree import Part
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Behavior
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.lfd import plan_task
from bt_jax.tasks import load_task

STACK = load_task("stack")
SIDE = "move(GreenBox, (0, 0, 0.055), KittingBox)"


@pytest.fixture
def studio(tmp_path, monkeypatch):
    """A studio whose corrections are not tried by a process."""
    studio = Studio(Workspace(tmp_path), STACK)
    monkeypatch.setattr(studio.correction, "_try", lambda: None)
    studio.take_tree(plan_task(STACK), None)
    return studio


def test_what_runs_follows_each_change_and_its_undo(studio):
    correction, plan = studio.correction, plan_task(STACK)
    with pytest.raises(UserError, match="no tree is edited"):
        correction.edit(edited_tree.delete)
    correction.begin(plan)
    correction.select((1,))
    correction.edit(edited_tree.switch)
    assert one_line(studio.playing.tree) == f"Sequence({plan.children[0]})"
    assert correction.can_undo
    correction.undo()
    assert (studio.playing.tree, correction.selected) == (plan, (1,))
    correction.redo()
    assert studio.playing.tree != plan
    correction.end()
    assert correction.part is None


def test_what_the_task_does_not_have_is_refused(studio):
    studio.correction.begin(plan_task(STACK))
    red = Part(Behavior("pick", ("RedBox",)))
    with pytest.raises(UserError, match="RedBox"):
        studio.correction.edit(lambda part, path: edited_tree.insert(part, path, red, "inside"))
    assert not studio.correction.can_undo


def test_evolution_begins_at_the_tree_and_without_what_is_switched_off(studio):
    correction = studio.correction
    correction.begin(plan_task(STACK))
    correction.edit(lambda part, _: edited_tree.insert(part, (), Part(parse_tree(SIDE)), "inside"))
    correction.edit(lambda part, _: edited_tree.switch(part, (2,)))
    begin = correction.beginning(STACK)
    assert begin.baseline == plan_task(STACK)
    assert begin.without == (parse_tree(SIDE),)
    correction.edit(lambda part, _: edited_tree.delete(part, (2,)))
    correction.edit(lambda part, _: edited_tree.lock(part, ()))
    locked = correction.beginning(STACK)
    assert locked.baseline.body == plan_task(STACK)
    assert locked.without == ()


def test_another_task_ends_it(studio):
    studio.correction.begin(plan_task(STACK))
    studio.open_task(load_task("pyramid"))
    assert studio.correction.part is not None  # which has the same objects
    studio.open_task(load_task("kit4"))
    assert studio.correction.part is None


@pytest.mark.slow
def test_a_change_is_tried_in_many_starts_and_the_last_one_counts(tmp_path):
    async def scenario():
        studio = Studio(Workspace(tmp_path), STACK)
        correction, plan = studio.correction, plan_task(STACK)
        try:
            correction.begin(parse_tree("Sequence(open_gripper, close_gripper)"))
            await asyncio.sleep(0.1)
            correction.begin(plan)  # nobody waits for the first any more
            while correction.tried is None or correction.tried.tried < STARTS:
                assert not correction.problem
                await asyncio.sleep(0.05)
            return correction.tried
        finally:
            correction.close()

    tried = asyncio.run(scenario())
    assert (tried.solved, tried.reasons, tried.sentence) == (100, (), "works in 100 of 100")
