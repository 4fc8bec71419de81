"""What of a window is refreshed after a change."""

import pytest

from bt_jax.app.state.refreshing import Refreshing


@pytest.fixture
def called():
    return []


@pytest.fixture
def refreshing(called):
    return Refreshing(lambda callback: called.append(callback()), "task")


def test_what_is_shown_is_refreshed_at_once(refreshing, called):
    refreshing.notice("task", lambda: "the task")()
    refreshing.notice(None, lambda: "the header")()
    assert called == ["the task", "the header"]


def test_what_is_hidden_is_refreshed_once_when_it_is_shown(refreshing, called):
    def scene():
        return "the scene"

    on_task, on_scene = (refreshing.notice("run", scene) for _ in range(2))  # two topics, one callback
    other = refreshing.notice("keep", lambda: "the list")
    for changed in (on_task, on_scene, other, on_task):
        changed()
    assert called == []
    refreshing.show("run")
    assert called == ["the scene"]
    refreshing.show("task")
    refreshing.show("run")
    assert called == ["the scene"]  # nothing has changed since
    on_task()
    assert called == ["the scene"] * 2
