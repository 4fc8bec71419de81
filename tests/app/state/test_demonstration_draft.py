"""A demonstration in the making, kept on disk and done again."""

import asyncio
import json

import numpy as np
import pytest

from bt_jax.app.state.studio import Studio
from bt_jax.tasks import load_task
from tests.helpers.asynchronous import in_loop

TASK = load_task("stack")


async def teach_something(studio):
    await studio.teaching.begin(reached=False)
    await studio.teaching.pick("GreenBox")
    for _ in range(3):
        await studio.teaching.move("up")
    await studio.teaching.carry_over("KittingBox")
    await studio.teaching.release()
    await studio.teaching.pick("YellowBox")
    await studio.teaching.carry_over("GreenBox")
    await studio.teaching.move("up")
    await studio.drafts.kept()


@in_loop
async def test_a_demonstration_in_the_making_outlives_a_killed_page(studio):
    await studio.library.use_set("mine")
    await teach_something(studio)
    after = Studio(studio.workspace, load_task("yumi_stack"))
    after.restore()
    assert "was restored, with 3 actions" in after.notices.standing[0].text
    assert (after.library.set_name, after.edited.task) == ("mine", TASK)
    again, before = after.teaching, studio.teaching
    assert again.done == before.done
    np.testing.assert_allclose(again.session.world.poses, before.session.world.poses, atol=1e-6)
    for teaching in (again, before):
        await teaching.undo()  # as far as it was carried
        await teaching.undo()
    assert again.done == before.done == before.done[:2]
    assert len(again.done) == 2
    await again.finish()
    assert after.notices.standing == ()
    assert studio.workspace.demonstration_set("mine").names() == ["demo1"]
    await after.drafts.kept()
    assert studio.workspace.demonstration_draft() is None


@in_loop
async def test_a_restored_demonstration_can_be_discarded(studio):
    await teach_something(studio)
    after = Studio(studio.workspace, TASK)
    after.restore()
    await after.notices.standing[0].discard.do()
    await after.drafts.kept()
    assert (after.teaching.session, after.notices.standing) == (None, ())
    assert studio.workspace.demonstration_draft() is None


@in_loop
async def test_a_restored_demonstration_is_discarded_by_its_notice_until_somebody_goes_on_with_it(studio):
    await teach_something(studio)
    after = Studio(studio.workspace, TASK)
    after.restore()
    (notice,) = after.notices.standing
    assert notice.discard.steers == "gripper"
    assert notice.discard.question == "Discard this demonstration? Its actions will be lost."
    after.teaching.set_step(0.01)
    assert after.notices.standing == (notice,)
    await after.teaching.move("up")
    assert after.notices.standing == ()


@in_loop
async def test_a_demonstration_goes_to_the_set_that_it_was_begun_in(studio):
    await studio.library.use_set("one")
    await teach_something(studio)
    await studio.teaching.release()
    await studio.library.use_set("other")
    await studio.teaching.finish()
    assert studio.workspace.demonstration_set("one").names() == ["demo1"]
    assert studio.workspace.demonstration_sets() == ["one"]


def start_at(key, value):
    """A change of the start in the text of a draft."""

    def change(text):
        data = json.loads(text)
        data["start"][key] = value
        return json.dumps(data)

    return change


def carry_to(*position):
    """A change of where the first object is carried in the text of a draft."""

    def change(text):
        data = json.loads(text)
        data["inputs"][1] = ["carry", position]
        return json.dumps(data)

    return change


IMPLAUSIBLE = {
    "held 100": start_at("held", [100]),
    "held 1000": start_at("held", [1000]),
    "held -5": start_at("held", [-5]),
    "held already": start_at("held", [0]),
    "kit far": start_at("kits", [[[1e20, 0.0, 0.0]]]),
    "boxes far": start_at("poses", [[[11.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]] * len(TASK.objects)]),
    "no rotation": start_at("poses", [[[0.0] * 7] * len(TASK.objects)]),
    "carried far": carry_to(1e300, 0.0, 0.1),
    "carried nowhere": carry_to(float("nan"), 0.0, 0.1),
}


@pytest.mark.parametrize("damage", IMPLAUSIBLE)
def test_an_implausible_demonstration_is_kept_aside(studio, tmp_path, damage):
    asyncio.run(teach_something(studio))
    draft = tmp_path / "demonstration_draft.json"
    draft.write_text(IMPLAUSIBLE[damage](draft.read_text()))
    after = Studio(studio.workspace, TASK)
    after.restore()
    assert "It is kept as demonstration_draft.json.unreadable." in after.notices.standing[0].text
    assert after.teaching.session is None


def test_whatever_fails_while_a_demonstration_is_done_again_the_page_starts(studio, tmp_path, monkeypatch):
    def fail(*_):
        raise IndexError("out of range")

    asyncio.run(teach_something(studio))
    monkeypatch.setattr("bt_jax.app.state.demonstration_draft.Teleoperation.pick", fail)
    after = Studio(studio.workspace, load_task("yumi_stack"))
    after.restore()
    assert "it cannot be done again (out of range)" in after.notices.standing[0].text
    assert (after.edited.task.name, after.library.set_name) == ("yumi_stack", studio.library.set_name)


@pytest.mark.parametrize("damage", ["{", "[]", '{"task": {}}', "missing box", "bad number", "unknown input"])
def test_a_demonstration_that_cannot_be_restored_is_kept_aside(studio, tmp_path, damage):
    path = tmp_path / "demonstration_draft.json"
    asyncio.run(teach_something(studio))
    whole = path.read_text()
    broken = {
        "missing box": whole.replace('["pick", "YellowBox"]', '["pick", "Cup"]'),
        "bad number": whole.replace('"kits": [[[', '"kits": [[[NaN, '),
        "unknown input": whole.replace('"release"', '"throw"'),
    }.get(damage, damage)
    assert broken != whole
    path.write_text(broken)
    after = Studio(studio.workspace, TASK)
    after.restore()
    (notice,) = after.notices.standing
    assert "cannot be restored" in notice.text
    assert "It is kept as demonstration_draft.json.unreadable." in notice.text
    assert str(tmp_path) not in notice.text
    assert (path.with_name(f"{path.name}.unreadable").read_text(), after.teaching.session) == (broken, None)
