import asyncio
import dataclasses

import numpy as np
import pytest

from bt_jax.app.state.arrangement import untarget
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.tasks import Box, load_task

TREE = parse_tree("move(YellowBox, (0, 0, 0.055), KittingBox)")


@pytest.fixture
def studio(tmp_path):
    studio = Studio(Workspace(tmp_path), load_task("stack3"))
    studio.run, studio.tree = "run", TREE
    return studio


def other_boxes(task):
    boxes = (*task.boxes, Box("Cup", 0.05, (1.0, 0.0, 0.0)))
    return dataclasses.replace(task, name="cups", boxes=boxes)


def test_a_tree_stays_as_long_as_there_are_the_same_things(studio):
    studio.set_task(load_task("pyramid"))
    assert (studio.run, studio.tree) == ("run", TREE)
    studio.set_task(other_boxes(studio.task))
    assert (studio.run, studio.tree) == (None, None)


def test_all_who_listen_see_a_whole_change(studio):
    seen = []
    for topic in ("task", "scene", "player"):
        studio.subscribe(topic, lambda: seen.append(studio.start.poses.shape[1] == len(studio.task.boxes)))
    studio.set_task(other_boxes(studio.task))
    studio.amend(untarget(studio.task, "BlueBox"))
    assert seen
    assert all(seen)


def test_what_a_person_changes_while_an_evolution_starts_stays(studio, monkeypatch):
    class Evolution:
        run, tree, running, gone, sentence = "run", TREE, True, False, ""
        stage, following = "starting", "evolving"

        def poll(self):
            self.stage = self.following
            return True

    config = dataclasses.make_dataclass("Config", ["task"])(load_task("pyramid"))
    folder = dataclasses.make_dataclass("Folder", ["config"])(lambda: config)
    monkeypatch.setattr(Workspace, "run", lambda self, name: folder)
    for edited in (False, True):
        studio.evolution = Evolution()
        studio.amend(load_task("stack3"))
        studio.evolution.following = "starting"
        studio.watch()
        if edited:
            studio.amend(untarget(studio.task, "BlueBox"))
        studio.evolution.following = "evolving"
        studio.watch()
        expected = untarget(load_task("stack3"), "BlueBox") if edited else load_task("pyramid")
        assert studio.task == expected


def test_work_is_done_one_after_the_other(studio):
    done = []

    async def check():
        await asyncio.gather(*(studio.work(done.append, i) for i in range(20)))

    asyncio.run(check())
    assert done == list(range(20))


def test_a_demonstration_in_the_making_stays_where_it_is(studio):
    studio.session = object.__new__(type("Session", (), {"actions": ()}))
    moved = dataclasses.replace(studio.shown, poses=studio.shown.poses + np.float32(0.1))
    studio.shown = moved
    studio.amend(untarget(studio.task, "BlueBox"), studio.start)
    np.testing.assert_array_equal(studio.shown.poses, moved.poses)
