"""A person builds a kit from nothing: three boxes into a tray, and finds a tree for it; every step is counted."""

import pytest
from playwright.sync_api import expect

from bt_jax.tasks import load_task
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.scene import at_rest, drag, exists, on_screen, position
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow
MOST_CLICKS = 40


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


class Mouse:
    """A person with nothing but a mouse; counts how often its button is pressed."""

    def __init__(self, page, see):
        self.page, self.see, self.clicks = page, see, 0

    def click(self, testid):
        self.see(testid).click()
        self.clicks += 1

    def drag(self, name, to):
        drag(self.page, name, to, arranging="targets")
        self.clicks += 1


def test_three_boxes_into_a_tray_with_the_mouse(page, see):
    mouse = Mouse(page, see)
    mouse.click("task-all")
    expect(see("start-task-stack")).to_be_visible()
    mouse.click("start-new")
    expect(see("task-problems")).to_contain_text("Nothing has to be anywhere yet")
    for name in ("BoxB", "BoxC"):
        mouse.click("kit-add-box")
        expect(see(f"kit-thing-{name}")).to_be_visible()
    mouse.click("kit-thing-TrayA")
    mouse.click("kit-click-slots")
    at_rest(page)
    x, y, z = position(page, "TrayA")
    for number, right in enumerate((-0.12, 0.0, 0.12), start=1):
        page.mouse.click(*on_screen(page, [x + right, y, z]))
        mouse.clicks += 1
        expect(see(f"kit-slot-s{number}")).to_be_visible()
        at_rest(page)
    mouse.click("task-targets")
    for name, right in (("BoxA", -0.12), ("BoxB", 0.0), ("BoxC", 0.12)):
        mouse.drag(name, [x + right + 0.01, y - 0.01])
        expect(see(f"task-words-{name}")).to_contain_text("of TrayA")
    expect(see("task-problems")).to_have_text("")
    for number, name in enumerate(("BoxA", "BoxB", "BoxC"), start=1):
        expect(see(f"task-words-{name}")).to_have_text(f"in slot s{number} of TrayA")
    mouse.click("task-save")
    expect(see("task-saved")).to_have_text("Saved as tasks/kit_1.yaml")
    mouse.click("tab-evolve")
    mouse.click("evolve-start")
    expect(see("evolve-stage")).to_have_text("finished", timeout=600_000)
    expect(see("evolve-sentence")).to_contain_text("works in 100 of 100 starts")
    print(f"three boxes into a tray: {mouse.clicks} clicks")
    assert mouse.clicks <= MOST_CLICKS


def test_a_kit_is_built_with_the_keyboard_undone_and_restored(page, see, server):
    go(see, "task")
    press_on(see("task-all"), "Enter")
    press_on(see("start-new"), "Enter")
    expect(see("kit-thing-BoxA")).to_be_visible()
    kit = see("task-choice").input_value()
    press_on(see("kit-add-can"), "Enter")
    expect(see("kit-name")).to_have_value("CanA")
    for field, value in (("kit-name", "Tin"), ("kit-count", "2"), ("kit-size-high", "50")):
        see(field).focus()
        page.keyboard.press("Control+A")
        page.keyboard.type(value)
        page.keyboard.press("Enter")
        expect(see("kit-thing-Tin")).to_be_visible()
    expect(see("kit-thing-Tin")).to_have_text("Tin \N{MULTIPLICATION SIGN} 2")
    press_on(see("kit-thing-TrayA"), "Enter")
    press_on(see("kit-add-slot"), "Enter")
    expect(see("kit-slot-s1")).to_be_visible()
    see("kit-slot-s1-right").focus()
    page.keyboard.press("Control+A")
    page.keyboard.type("80")
    page.keyboard.press("Tab")
    expect(see("kit-slot-s1-back")).to_be_focused()
    see("task-targets").click()
    see("task-sentence").focus()
    page.keyboard.type("any tin into traya s")
    expect(see("task-offer-0")).to_have_text("a Tin in slot s1 of TrayA")
    press_on(see("task-offer-0"), "Enter")
    expect(see("task-words-Tin-1")).to_have_text("in slot s1 of TrayA")
    assert exists(page, "Tin-1")
    press_on(see("task-sentence"), "x")
    page.keyboard.press("Enter")
    expect(see("message")).to_contain_text("write for instance")
    see("task-sentence").fill("")
    for _ in range(3):
        page.keyboard.press("Escape")
        see("task-undo").click()
    expect(see("task-words-Tin-1")).to_have_text("2 may be anywhere")
    for _ in range(3):
        see("task-redo").click()
    expect(see("task-words-Tin-1")).to_have_text("in slot s1 of TrayA")
    with page.expect_download() as download:
        see("task-download").click()
    text = download.value.path().read_bytes()
    server.restart(page)
    page.goto(server.url)
    expect(see("task-words-Tin-1")).to_have_text("in slot s1 of TrayA")
    see("task-save").click()
    expect(see("task-saved")).to_have_text(f"Saved as tasks/{kit}.yaml")
    see("task-all").click()
    see("start-upload").locator("input[type=file]").set_input_files(
        {"name": "copy.yaml", "mimeType": "application/yaml", "buffer": text}
    )
    expect(see("task-choice")).to_have_value(f"{kit}_2")
    see("task-save").click()
    expect(see("task-saved")).to_have_text(f"Saved as tasks/{kit}_2.yaml")
    assert load_task(server.folder / "tasks" / f"{kit}.yaml").instances["Tin"] == ("Tin1", "Tin2")


def test_things_that_cannot_work_are_said_and_a_tray_is_dragged(page, see):
    go(see, "task")
    see("task-all").click()
    see("start-new").click()
    see("kit-thing-BoxA").click()
    for side in ("long", "deep"):
        see(f"kit-size-{side}").fill("150")
        page.keyboard.press("Enter")
    expect(see("task-problems")).to_contain_text(
        "150 mm does not fit the gripper, which opens 120 mm; make BoxA smaller."
    )
    see("task-undo").click()
    expect(see("task-problems")).not_to_contain_text("gripper")
    see("kit-thing-TrayA").click()
    x, y, z = position(page, "TrayA")
    at_rest(page)
    page.wait_for_timeout(300)
    start = on_screen(page, [x - 0.06, y - 0.1, z])
    page.mouse.move(*start)
    page.mouse.down()
    for part in (0.2, 1.0):
        page.mouse.move(*on_screen(page, [x - 0.06, y - 0.1 + 0.1 * part, z]))
    page.mouse.up()
    expect(see("kit-place-back")).not_to_have_value("0")
    expect(see("kit-thing-TrayA")).to_have_attribute("aria-pressed", "true")
