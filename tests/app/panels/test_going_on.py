"""A person answers for which task an evolution goes on while another window may change everything."""

import asyncio
import dataclasses
from types import SimpleNamespace

import pytest
from nicegui import Client, ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.going_on import ask_goal
from bt_jax.tasks import load_task
from bt_jax.training.phases import Changes

STACK = load_task("stack")
FEWER = dataclasses.replace(STACK, targets=STACK.targets[:1])
CHANGES = Changes(baseline_index=1)


def asked(studio, answer, meanwhile=lambda: None):
    """What `ask_goal` returns if a person presses a button, after what happens meanwhile."""

    def press(client):
        meanwhile()
        (button,) = (one for one in client.elements.values() if one.props.get("data-testid") == answer)
        for listener in button._event_listeners.values():
            button._handle_event({"listener_id": listener.id, "args": None})

    async def ask():
        with Client(ui.page("")) as client:
            asyncio.get_running_loop().call_soon(press, client)
            return await ask_goal(studio, CHANGES)

    return asyncio.run(ask())


@pytest.fixture
def studio():
    evolution = SimpleNamespace(run="run", task=STACK)
    return SimpleNamespace(evolution=evolution, edited=SimpleNamespace(task=FEWER), in_step=False)


def test_the_answer_is_added_to_the_changes(studio):
    assert asked(studio, "goal-own") == CHANGES
    assert asked(studio, "goal-edited") == dataclasses.replace(CHANGES, task=FEWER)
    assert asked(studio, "goal-cancel") is None


def test_the_task_is_the_one_that_was_shown(studio):
    def another():
        studio.edited.task = load_task("pyramid")

    assert asked(studio, "goal-edited", another).task == FEWER


def test_another_run_that_was_opened_meanwhile_does_not_go_on(studio):
    def another():
        studio.evolution.run = "other"

    with pytest.raises(UserError, match="opened meanwhile"):
        asked(studio, "goal-own", another)
