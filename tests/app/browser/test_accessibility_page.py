"""People who see little, or nothing, or use no mouse, can use every step."""

import pytest
from playwright.sync_api import expect

from tests.helpers.browser.axe import axe_script, grave_faults
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow

STEPS = ("task", "evolve", "demonstrate", "understand", "combine", "run", "keep")
AXE = axe_script()
needs_axe = pytest.mark.skipif(AXE is None, reason="axe-core is not installed; see CONTRIBUTING.md")


def choose_colours(see, name):
    see("appearance").select_option(label=name)


@needs_axe
@pytest.mark.parametrize("colours", ["Light", "Dark", "High contrast"])
def test_no_step_keeps_anybody_out(page, see, colours):
    choose_colours(see, colours)
    page.emulate_media(reduced_motion="reduce")  # what fades in has not its contrast yet
    for step in STEPS:
        go(see, step)
        assert grave_faults(page, AXE) == [], step


def test_the_colours_follow_the_system_until_somebody_chooses(page, see):
    def expect_colours(scheme, contrast):
        html = page.locator("html")
        expect(html).to_have_attribute("data-scheme", scheme)
        expect(html).to_have_attribute("data-contrast", contrast)

    def background():
        return page.locator(".page").evaluate("page => getComputedStyle(page).backgroundColor")

    choose_colours(see, "As the system")
    page.emulate_media(color_scheme="light", contrast="no-preference")
    expect_colours("light", "normal")
    light = background()
    page.emulate_media(color_scheme="dark")
    expect_colours("dark", "normal")
    assert background() != light
    page.emulate_media(contrast="more")
    expect_colours("dark", "more")
    page.emulate_media(color_scheme="dark", contrast="no-preference")
    choose_colours(see, "Light")
    expect_colours("light", "normal")
    assert background() == light
    page.reload()
    expect(see("appearance")).to_have_value("light")
    expect_colours("light", "normal")
    assert background() == light
    choose_colours(see, "As the system")


def test_the_page_says_its_language(page):
    assert page.evaluate("document.documentElement.lang") == "en-US"


def test_the_scene_and_the_tree_are_told_to_those_who_do_not_see_them(page, see):
    go(see, "task")
    expect(see("scene-list")).to_contain_text("The gripper is empty.")
    expect(see("scene-list")).to_contain_text("YellowBox should be in the middle of the kit: it is ")
    expect(see("scene-list").locator("li")).to_have_count(6)
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    page.keyboard.press("1")
    expect(see("scene-list")).to_contain_text("YellowBox is in the gripper.")
    expect(see("scene-news")).to_have_text("YellowBox is in the gripper.")
    see("demonstrate-over-KittingBox").click()
    page.keyboard.press("r")
    expect(see("scene-list")).to_contain_text("YellowBox is in the middle of the kit.")
    expect(see("scene-news")).to_have_text("YellowBox is in the middle of the kit.")
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()
