"""A kit of several shapes goes through all steps: slots are named and catch what is dropped, and parts are turned."""

import pytest
from playwright.sync_api import expect

from bt_jax.tasks import load_task
from tests.helpers.browser.menus import choose_option
from tests.helpers.browser.scene import COMPONENT, at_rest, drag, position
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow

KIT = load_task("kit4")


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


@pytest.fixture(autouse=True)
def chosen(page, see):
    """Every test begins with the kit."""
    go(see, "task")
    if see("task-choice").input_value() != "kit4":
        choose_option(page, see("task-choice"), "kit4")
    expect(see("task-description")).to_have_text(KIT.description)
    at_rest(page)


def names_in_the_scene(page):
    """The names that are shown, as boxes on the screen: left, right, top, bottom [pixels], and whether of a slot."""
    return page.evaluate(
        f"""() => {{ {COMPONENT}
          return c.tags.filter((tag) => tag.visible).map((tag) => {{
            const at = tag.getWorldPosition(c.camera.position.clone()).project(c.camera);
            const [width, height] = c.extent, high = tag.userData.height, across = high * tag.userData.shape;
            const left = (at.x + 1) / 2 * width - tag.center.x * across;
            const top = (1 - at.y) / 2 * height - (1 - tag.center.y) * high;
            return [left, left + across, top, top + high, tag.userData.rank];
          }});
        }}"""
    )


def test_names_of_objects_and_slots_keep_apart(page, see):
    choose_option(page, see("task-choice"), "kit12")
    expect(see("task-description")).to_have_text(load_task("kit12").description)
    at_rest(page)
    shown = names_in_the_scene(page)
    assert len(shown) > 16
    for i, (left, right, top, bottom, _) in enumerate(shown):
        for other_left, other_right, other_top, other_bottom, _ in shown[:i]:
            across = min(right, other_right) - max(left, other_left)
            down = min(bottom, other_bottom) - max(top, other_top)
            assert min(across, down) <= 3.01


def test_a_target_and_an_object_are_caught_by_a_slot(page, see):
    x, y, z = position(page, "Tray")
    slots = {slot.name: slot.position for slot in KIT.kits[0].places}
    can = slots["can"]
    drag(page, "Can", [x, y - 0.29, z], target=True)
    expect(see("task-words-Can")).not_to_contain_text("slot")
    drag(page, "Can", [x + can[0] + 0.02, y + can[1] - 0.02, z], target=True)
    expect(see("task-words-Can")).to_have_text("in slot can of Tray")
    expect(see("message")).to_contain_text("Can should be in slot can of Tray.")
    see("task-start").click()
    plate = slots["plate"]
    drag(page, "Plate", [x + plate[0] - 0.01, y + plate[1] + 0.02, z])
    expect(see("message")).to_contain_text("Plate starts in slot plate of Tray.")
    expect(see("scene-list")).to_contain_text("Plate is in slot plate of Tray")
    see("task-targets").click()


def test_a_part_is_turned_and_carried_to_its_slot(page, see):
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    page.keyboard.press("1")
    expect(see("demonstrate-slots").get_by_role("button")).to_have_count(1)
    before = see("demonstrate-pose-Tray-turn").inner_text()
    page.keyboard.press("q")
    expect(see("demonstrate-pose-Tray-turn")).not_to_have_text(before)
    see("demonstrate-slot-Tray.plate").click()
    expect(see("demonstrate-landing")).to_contain_text("Plate is set down in slot plate of Tray")
    page.keyboard.press("r")
    expect(see("demonstrate-done")).to_contain_text("Put Plate in slot plate of Tray")
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()


def test_a_kit_is_evolved_and_run(page, see):
    go(see, "evolve")
    see("evolve-start").click()
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("evolve-sentence")).to_contain_text("works in 100 of 100 starts")
    go(see, "run")
    choose_option(page, see("run-speed"), "4 \N{MULTIPLICATION SIGN}")
    see("run-play").click()
    expect(see("run-verdict")).to_have_text("The tree says that it is done. Everything is where it should be.")
    at_rest(page)
    for name in ("Plate", "Bar", "Can", "Block"):
        expect(see("scene-list")).to_contain_text(f"{name} is in slot {name.lower()} of Tray")
