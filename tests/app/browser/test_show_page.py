"""A person who demonstrates with the mouse or with a finger, in the scene."""

import pytest
from playwright.sync_api import expect

from bt_jax.lfd import DemonstrationFolder
from tests.helpers.browser.scene import drag, finger_drag, wait_for_copy
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


def test_experiment_1_is_demonstrated_by_mouse_only(page, see, server, shoot):
    go(see, "demonstrate")
    for number in range(1, 4):
        see("demonstrate-new").click()
        expect(see("demonstrate-finish")).to_be_visible()
        drag(page, "GreenBox", "YellowBox", arranging="hand")
        expect(see("demonstrate-done").locator("li").nth(1)).to_have_text("Put GreenBox on top of YellowBox")
        drag(page, "BlueBox", "GreenBox", arranging="hand")
        expect(see("demonstrate-done").locator("li").nth(3)).to_have_text("Put BlueBox on top of GreenBox")
        if number == 1:
            see("demonstrate-undo").click()  # a drag is one input
            expect(see("demonstrate-done").locator("li")).to_have_count(2)
            drag(page, "BlueBox", "GreenBox", arranging="hand")
            expect(see("demonstrate-done").locator("li")).to_have_count(4)
            shoot("show")
        see("demonstrate-finish").click()
        expect(see("demonstrate-progress")).to_contain_text(f"{number} ")
        expect(see("demonstrate-new")).to_be_visible()
    shown = DemonstrationFolder(server.folder / "demonstrations" / "demonstrations").read()
    assert [len(one.actions) for one in shown] == [4, 4, 4]
    see("demonstrate-overlay").click()
    wait_for_copy(page, "0 demo1", group="overlay")
    see("demonstrate-leave-demo3").click()
    expect(see("demonstrate-row-demo3")).to_contain_text("left out")
    expect(see("demonstrate-progress")).to_contain_text("2 of 3")
    see("demonstrate-leave-demo3").click()
    expect(see("demonstrate-progress")).to_contain_text("3 demonstrations")
    go(see, "understand")
    expect(see("understand-action-2")).to_contain_text("Set down GreenBox on top of YellowBox")
    expect(see("understand-action-4")).to_contain_text("Set down BlueBox on top of GreenBox")


def test_keys_survive_another_step_and_follow_the_view(page, see):
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    page.keyboard.press("r")  # nothing is held, which is no error
    expect(see("message")).to_contain_text("The gripper is empty")
    see("demonstrate-pick-GreenBox").click()
    expect(see("demonstrate-pose-base_link-x")).to_be_visible()
    wait_for_copy(page, "GreenBox", group="landing")
    go(see, "task")
    wait_for_copy(page, "GreenBox", group="landing", gone=True)
    go(see, "demonstrate")
    expect(page.locator("[data-teach-keys]")).to_be_focused()
    x = see("demonstrate-pose-base_link-x").inner_text()
    page.keyboard.press("ArrowRight")
    expect(see("demonstrate-pose-base_link-x")).not_to_have_text(x)
    y = see("demonstrate-pose-base_link-y").inner_text()
    scene = page.get_by_test_id("scene").bounding_box()
    page.mouse.move(scene["x"] + 20, scene["y"] + scene["height"] - 20)
    page.mouse.down()
    page.mouse.move(scene["x"] + 20 + scene["height"] / 4, scene["y"] + scene["height"] - 20, steps=4)
    page.mouse.up()
    page.keyboard.press("ArrowRight")
    expect(see("demonstrate-pose-base_link-y")).not_to_have_text(y)
    assert page.evaluate("document.activeElement !== document.body")
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()


def test_an_object_is_carried_and_turned_with_fingers(window, server):
    page = window()
    page.set_viewport_size({"width": 1024, "height": 768})
    see = page.get_by_test_id
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    finger_drag(page, "GreenBox", "YellowBox", taps=1)
    expect(see("demonstrate-done").locator("li").nth(1)).to_have_text("Put GreenBox on top of YellowBox")
    finger_drag(page, "BlueBox", "GreenBox", near=10)
    expect(see("demonstrate-done").locator("li").nth(3)).to_have_text("Put BlueBox on top of GreenBox")
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()
