"""Demonstrations laid over each other."""

import dataclasses

import numpy as np
import pytest

from bt_jax.app.state.extents import poses_now
from bt_jax.app.state.overlay import overlaid
from bt_jax.lfd import learn
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Target, load_task
from tests.helpers.asynchronous import in_loop

TASK = load_task("stack")
STACK = [Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox"), Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox")]
ODD = [Target("GreenBox", (0.25, 0.0, 0.0), "YellowBox"), STACK[1]]


def demonstrations():
    rng = np.random.default_rng(5)
    own, odd = (demonstration_set(TASK, targets, count=count, rng=rng) for targets, count in ((STACK, 3), (ODD, 1)))
    (last,) = odd.demonstrations
    return dataclasses.replace(own, demonstrations=(*own.demonstrations, dataclasses.replace(last, name="demo4")))


def test_places_are_shown_relative_to_what_they_belong_to():
    lesson, world = learn(demonstrations(), TASK), sample_layouts(TASK, 7, 1)
    found = overlaid(lesson, world, {"demo1", "demo2", "demo4"})
    yellow = poses_now(TASK, world)["YellowBox"][:3]
    green = {one.demonstration: one for one in found if one.thing == "GreenBox"}
    assert {*green} == {"demo1", "demo2", "demo4"}
    for name in ("demo1", "demo2"):
        assert green[name].pose[:3] - yellow == pytest.approx((0, 0, 0.1), abs=0.01)
        assert not green[name].disagrees
    assert green["demo4"].pose[:3] - yellow == pytest.approx((0.25, 0, 0), abs=0.01)
    assert green["demo4"].disagrees
    blue = next(one for one in found if (one.demonstration, one.thing) == ("demo1", "BlueBox"))
    assert blue.pose[2] - yellow[2] == pytest.approx(0.2, abs=0.02)  # on the box that stands on the other


@in_loop
async def test_one_that_is_left_out_teaches_nothing_until_it_is_taken_in_again(studio):
    folder = studio.library.folder
    folder.create(demonstrations().frames)
    for one in demonstrations():
        folder.append(one)
    library = studio.library
    await library.refresh()
    assert [one.name for one in library.disagreements] == ["demo4"]
    assert library.progress.startswith("4 demonstrations")
    await library.leave_out("demo4", True)
    assert library.disagreements == ()
    assert [one.left_out for one in library.kept] == [False, False, False, True]
    assert library.progress.startswith("3 demonstrations")
    assert len(library.lesson.demonstrations) == 3
    await library.leave_out("demo4", False)
    assert [one.name for one in library.disagreements] == ["demo4"]
    for one in library.kept:
        await library.leave_out(one.name, True)
    assert (library.lesson, library.problem) == (None, "")
