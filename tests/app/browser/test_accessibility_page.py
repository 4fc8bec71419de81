"""People who see little, or nothing, or use no mouse, can use every step."""

import pytest
from playwright.sync_api import expect

from bt_jax.app.state.steps import STEPS
from tests.helpers.browser.axe import axe_script, grave_faults
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow

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


@needs_axe
def test_neither_does_a_dialog_nor_a_menu_nor_a_message(page, see):
    page.emulate_media(reduced_motion="reduce")
    go(see, "task")
    see("task-name").fill("../outside")
    see("task-save").click()
    expect(see("message")).to_contain_text("cannot name a task")
    assert grave_faults(page, AXE) == []
    go(see, "demonstrate")
    press_on(see("demonstrate-new-set"), "Enter")
    expect(page.get_by_role("dialog", name="Name of the new set")).to_be_visible()
    assert grave_faults(page, AXE) == []
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(see("demonstrate-new-set")).to_be_focused()
    see("demonstrate-set").click()
    options = page.get_by_role("listbox").get_by_role("option")
    expect(options.first).to_be_visible()
    assert grave_faults(page, AXE) == []
    page.keyboard.press("Escape")
    expect(options).to_have_count(0)


FOCUS = """() => {
  const focused = document.activeElement;
  const drawn = (element) => getComputedStyle(element).outlineStyle !== "none";
  return {
    name: focused.dataset.testid ?? focused.outerHTML.slice(0, 120),
    body: focused === document.body,
    seen: drawn(focused) || focused.closest(".q-field--focused") !== null || focused.matches(".foldable"),
  };
}"""


@pytest.mark.parametrize("step", STEPS)
def test_the_tab_key_reaches_everything_and_one_sees_where_it_is(page, see, step):
    go(see, step)
    see(f"tab-{step}").focus()
    found = []
    for _ in range(60):
        page.keyboard.press("Tab")
        found.append(page.evaluate(FOCUS))
        if found[-1]["body"]:
            break
    assert found[-1]["body"], "the focus is caught"
    assert [one["name"] for one in found[:-1] if not one["seen"]] == []
    reached = [one["name"] for one in found]
    shown = (
        page.locator(f"[data-testid=panel-{step}] [data-testid]")
        .locator("visible=true")
        .evaluate_all(
            "all => all.filter((one) => one.matches('button:not([disabled]), input')).map((one) => one.dataset.testid)"
        )
    )
    assert [name for name in shown if name not in reached] == []


def test_the_colours_follow_the_system_until_somebody_chooses(page, see):
    def expect_colours(scheme, contrast):
        html = page.locator("html")
        expect(html).to_have_attribute("data-scheme", scheme)
        expect(html).to_have_attribute("data-contrast", contrast)

    def expect_background(color, same=True):
        background = expect(page.locator(".page"))
        (background.to_have_css if same else background.not_to_have_css)("background-color", color)

    choose_colours(see, "As the system")
    page.emulate_media(color_scheme="light", contrast="no-preference")
    expect_colours("light", "normal")
    light = page.locator(".page").evaluate("page => getComputedStyle(page).backgroundColor")
    page.emulate_media(color_scheme="dark")
    expect_colours("dark", "normal")
    expect_background(light, same=False)
    page.emulate_media(contrast="more")
    expect_colours("dark", "more")
    page.emulate_media(color_scheme="dark", contrast="no-preference")
    choose_colours(see, "Light")
    expect_colours("light", "normal")
    expect_background(light)
    page.reload()
    expect(see("appearance")).to_have_value("light")
    expect_colours("light", "normal")
    expect_background(light)
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
