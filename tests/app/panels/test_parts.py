"""A person is asked whether unsaved changes may go while another window changes more."""

import asyncio
from types import SimpleNamespace

import pytest
from nicegui import Client, ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import may_leave
from bt_jax.tasks import load_task


def leaves(studio, answer, meanwhile=lambda: None):
    """What `may_leave` returns if a person presses a button, after what happens meanwhile."""

    def press(client):
        meanwhile()
        (button,) = (one for one in client.elements.values() if isinstance(one, ui.button) and one.text == answer)
        for listener in button._event_listeners.values():
            button._handle_event({"listener_id": listener.id, "args": None})

    async def ask():
        with Client(ui.page("")) as client:
            asyncio.get_running_loop().call_soon(press, client)
            return await may_leave(studio)

    return asyncio.run(ask())


@pytest.fixture
def studio():
    return SimpleNamespace(edited=SimpleNamespace(task=load_task("stack"), start=None), unsaved=True)


def test_unsaved_changes_go_only_if_a_person_says_so(studio):
    assert leaves(studio, "Discard them")
    assert not leaves(studio, "Cancel")


def test_changes_that_nobody_was_asked_about_stay(studio):
    def another():
        studio.edited.task = load_task("pyramid")

    with pytest.raises(UserError, match="changed in another window meanwhile"):
        leaves(studio, "Discard them", another)
