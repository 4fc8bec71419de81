"""Somebody who sees the page for the first time is led through it, and stays where the keyboard and the browser put them."""

import math
import re

import pytest
from playwright.sync_api import expect

from bt_jax.app.state.steps import STEPS, TITLES
from bt_jax.app.widgets.tour import STOPS
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.scene import COMPONENT, at_rest
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow


def test_the_tour_begins_by_itself_once_and_whenever_it_is_asked_for(window):
    page = window(first_visit=True)
    see = page.get_by_test_id
    expect(see("tour-next")).to_be_focused()
    for number, stop in enumerate(STOPS, start=1):
        expect(see("tour-count")).to_have_text(f"{number} of {len(STOPS)}")
        expect(see("tour-text")).to_have_text(stop.text)
        expect(see(f"panel-{stop.step}")).to_be_visible()
        expect(page.locator(stop.lit)).to_have_class(re.compile("tour-lit"))
        see("tour-next").click()
    expect(see("tour-card")).not_to_be_visible()
    expect(page.locator(".tour-lit")).to_have_count(0)
    expect(see("tour")).to_be_focused()
    page.reload()
    at_rest(page)
    expect(see("tour-card")).not_to_be_visible()
    see("tour").click()
    expect(see("tour-count")).to_have_text(f"1 of {len(STOPS)}")
    page.keyboard.press("Escape")
    expect(see("tour-card")).not_to_be_visible()


def test_the_tour_takes_two_minutes():
    words = sum(len(f"{stop.title} {stop.text}".split()) for stop in STOPS)
    assert 180 <= words <= 300  # at 150 words a minute
    assert {stop.step for stop in STOPS} == set(STEPS)


def test_every_step_says_what_comes_next_and_leads_there(page, see):
    for step in STEPS:
        go(see, step)
        expect(see("next-sentence")).not_to_have_text("")
        said = see("next").inner_text()
        (following,) = [other for other, title in TITLES.items() if title in said.removeprefix("Next: ").splitlines()]
        see("next").click()
        expect(see(f"panel-{following}")).to_be_visible()


def test_what_is_done_is_marked_and_what_is_taken_back_is_not(page, see):
    go(see, "task")
    expect(see("tab-task")).to_contain_text("done")
    see("task-remove-GreenBox").click()
    expect(see("tab-task")).not_to_contain_text("done")
    expect(see("tab-evolve")).not_to_contain_text("done")
    see("task-undo").click()
    expect(see("tab-task")).to_contain_text("done")


def test_back_and_forward_go_from_step_to_step(window):
    page = window()
    see = page.get_by_test_id
    for step in ("demonstrate", "keep"):
        go(see, step)
    page.go_back()
    expect(see("panel-demonstrate")).to_be_visible()
    page.go_back()
    expect(see("panel-task")).to_be_visible()
    page.go_forward()
    expect(see("panel-demonstrate")).to_be_visible()
    expect(see("tab-demonstrate")).to_have_attribute("aria-selected", "true")
    page.reload()
    expect(see("panel-demonstrate")).to_be_visible()


def test_the_scene_takes_as_much_room_as_it_is_given(window):
    page = window()
    bar, scene = page.get_by_test_id("splitter"), page.get_by_test_id("scene")

    def width():
        return scene.bounding_box()["width"]

    first = width()
    press_on(bar, "ArrowRight")
    expect(bar).to_have_attribute("aria-valuenow", "57")
    assert width() > first + 20
    press_on(bar, "Home")
    expect(bar).to_have_attribute("aria-valuenow", "25")
    box = bar.bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(640, box["y"] + 100)
    page.mouse.up()
    expect(bar).to_have_attribute("aria-valuenow", "50")
    page.reload()
    expect(bar).to_have_attribute("aria-valuenow", "50")
    bar.dblclick(position={"x": 5, "y": 40})
    expect(bar).to_have_attribute("aria-valuenow", "54")


def test_single_keys_can_be_switched_off(window):
    page = window()
    see = page.get_by_test_id
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    see("shortcuts").click()
    expect(see("shortcuts")).to_have_attribute("aria-pressed", "false")
    page.reload()
    expect(see("shortcuts")).to_have_attribute("aria-pressed", "false")
    expect(see("demonstrate-finish")).to_be_visible()
    page.keyboard.press("1")
    see("demonstrate-larger").click()  # which is answered after the key would be
    expect(see("demonstrate-step")).not_to_have_value("20")
    expect(see("demonstrate-done")).to_contain_text("nothing yet")
    see("shortcuts").click()
    page.keyboard.press("1")
    expect(see("demonstrate-done")).to_contain_text("Pick up YellowBox")
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()


def test_the_focus_never_falls_to_the_body(page, see):
    """What had it is disabled, removed, or hidden with its step."""

    def expect_focus():
        page.wait_for_function("() => document.activeElement !== document.body")
        return page.evaluate("document.activeElement.closest('.page-panel')?.dataset.testid")

    go(see, "task")
    press_on(see("task-remove-GreenBox"), "Enter")
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    assert expect_focus() == "panel-task"
    press_on(see("task-undo"), "Enter")
    expect(see("task-undo")).to_be_disabled()
    assert expect_focus() == "panel-task"
    go(see, "demonstrate")
    press_on(see("demonstrate-new"), "Enter")
    expect(see("demonstrate-finish")).to_be_visible()
    assert expect_focus() == "panel-demonstrate"
    press_on(see("demonstrate-discard"), "Enter")
    expect(see("demonstrate-new")).to_be_visible()
    assert expect_focus() == "panel-demonstrate"
    go(see, "understand")
    press_on(see("understand-demonstrate"), "Enter")
    expect(see("panel-demonstrate")).to_be_visible()
    assert expect_focus() == "panel-demonstrate"


def test_buttons_show_the_scene_from_where_one_wants(page, see):
    at_rest(page)

    def direction():
        return page.evaluate(
            f"() => {{ {COMPONENT} return c.camera.position.clone().sub(c.controls.target).normalize().toArray(); }}"
        )

    def everything_fits():
        return page.evaluate(
            f"""() => {{ {COMPONENT}
              c.camera.updateMatrixWorld();
              const [low, high] = c.model.shown;
              return [0, 1, 2, 3, 4, 5, 6, 7].every((i) => {{
                const corner = [0, 1, 2].map((k) => ((i >> k) & 1 ? high[k] : low[k]));
                const at = c.camera.position.clone().set(...corner).project(c.camera);
                return Math.abs(at.x) <= 1 && Math.abs(at.y) <= 1;
              }});
            }}"""
        )

    for name, expected in (("front", (0, -1)), ("side", (1, 0)), ("top", (0, 0))):
        see(f"view-{name}").click()
        assert math.dist(direction()[:2], expected) < 0.05, name
        assert everything_fits(), name
    see("view-nearer").click()
    assert not everything_fits()
    see("view-home").click()
    assert everything_fits()
