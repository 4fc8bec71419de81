"""What a notice tells of is discarded only by who may steer it, and only after a question."""

import asyncio

import pytest
from nicegui import Client, ui

from bt_jax._util.errors import UserError
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.holds import Holds, Window
from bt_jax.app.state.notices import Discard, Notice, Notices
from bt_jax.app.widgets import notice_strip
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.notice_strip import NoticeStrip

ANNA, BEN = Window("a", "10.0.0.1"), Window("b", "10.0.0.2")


class Shown(PageContext):
    """Ben's window with a strip that shows one notice; `said` is what it says, `done` what was discarded."""

    window, step = BEN, "task"

    def __init__(self):
        bus = Bus()
        self.holds, self.notices, self.said, self.done = Holds(bus), Notices(bus), [], []
        self.handlers = {}  # of the buttons, by what they steer
        self.notice = Notice("It was restored.", Discard(lambda: self.done.append("it"), "Discard it?", "gripper"))
        self.notices.add(self.notice)
        NoticeStrip(self.notices, self)

    def on(self, topic, callback, *, now=True):
        callback()

    def steer(self, thing):
        self.holds.take(thing, self.window)

    def guard(self, handler, *, steers=None):
        async def guarded():
            try:
                if steers is not None:
                    self.steer(steers)
                await handler()
            except UserError as error:
                self.said.append(str(error))

        self.handlers[steers] = guarded
        return guarded


def pressed(monkeypatch, *, answer=True, before=lambda shown: None, meanwhile=lambda shown: None):
    """The strip after Discard was pressed; `meanwhile` happens while the question is asked."""

    async def press():
        with Client(ui.page("")):
            shown = Shown()

            async def ask(question, *, yes, testid):
                assert (question, yes) == ("Discard it?", "Discard")
                meanwhile(shown)
                return answer

            monkeypatch.setattr(notice_strip, "ask", ask)
            before(shown)
            await shown.handlers["gripper"]()
            return shown

    return asyncio.run(press())


@pytest.mark.parametrize("answer", [True, False])
def test_a_person_is_asked_before_it_is_discarded(monkeypatch, answer):
    shown = pressed(monkeypatch, answer=answer)
    assert shown.done == (["it"] if answer else [])
    assert shown.notices.standing == (() if answer else (shown.notice,))


@pytest.mark.parametrize("when", ["before", "meanwhile"])
def test_what_another_window_steers_is_not_discarded(monkeypatch, when):
    def anna_takes_it(shown):
        shown.holds.let_go(BEN)
        shown.holds.take("gripper", ANNA)

    shown = pressed(monkeypatch, **{when: anna_takes_it})
    assert shown.done == []
    assert "has the gripper" in shown.said[0]


def test_what_has_changed_while_it_was_asked_is_not_discarded(monkeypatch):
    shown = pressed(monkeypatch, meanwhile=lambda shown: shown.notices.remove(shown.notice))
    assert shown.done == []
    assert "changed in another window meanwhile" in shown.said[0]
