"""A person who says what is to be done: targets and the beginning, by dragging and by keyboard, and saves it."""

import math

import pytest
from playwright.sync_api import expect

from bt_jax.tasks import load_task, task_names
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.menus import choose_option
from tests.helpers.browser.scene import COMPONENT, at_rest, drag, exists, position
from tests.helpers.browser.steps import go, until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


STACK = load_task("stack")


@pytest.fixture(autouse=True)
def fresh(page, see):
    """Every test begins with the targets of the task `stack` as it comes with the package."""
    go(see, "task")
    see("task-targets").click()
    at_rest(page)
    if see("task-revert").is_visible():
        see("task-revert").click()
        expect(see("task-revert")).not_to_be_visible()
    if see("task-choice").input_value() != "stack" or see("task-undo").is_enabled() or see("task-redo").is_enabled():
        if see("task-choice").input_value() != "pyramid":
            choose(page, see, "pyramid")
        choose(page, see, "stack")
    expect(see("task-saved")).to_have_text("")
    at_rest(page)


def choose(page, see, name, *, described=None):
    """Chooses a task, and waits for its description, or for that of the one that the page does not leave unasked."""
    choose_option(page, see("task-choice"), name)
    if (described or name) in task_names():
        expect(see("task-description")).to_have_text(load_task(described or name).description)


def fill(page, see, field, value):
    see(field).fill(f"{value}")
    page.keyboard.press("Enter")


def say_no(page):
    """Closes the dialog that asks, and waits until that is done."""
    page.get_by_text("Cancel").click()
    expect(page.locator(".q-dialog")).to_have_count(0)


def close(a, b, within=0.02):
    return math.dist(a, b) < within


def test_the_scene_shows_where_boxes_should_end(page, see):
    expect(see("task-words-YellowBox")).to_have_text("in the middle of the kit")
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")
    yellow, green = (position(page, name, target=True) for name in ("YellowBox", "GreenBox"))
    assert close(green, [yellow[0], yellow[1], yellow[2] + 0.1])
    assert not exists(page, "BlueBox")
    choose(page, see, "pyramid")
    until(page, lambda: exists(page, "BlueBox"))


def test_one_looks_from_elsewhere_by_keyboard(page):
    at_rest(page)
    canvas = page.get_by_test_id("scene").locator("canvas")

    def eye():
        return page.evaluate(
            f"() => {{ {COMPONENT} return c.camera.position.clone().sub(c.controls.target).toArray(); }}"
        )

    first = eye()
    press_on(canvas, "ArrowUp")
    until(page, lambda: eye()[2] > first[2] + 0.05)
    assert math.hypot(*eye()) == pytest.approx(math.hypot(*first))
    press_on(canvas, "-")
    until(page, lambda: math.hypot(*eye()) > 1.05 * math.hypot(*first))
    x, y, _ = eye()
    press_on(canvas, "ArrowRight")
    until(page, lambda: x * eye()[1] - y * eye()[0] > 0.05)
    canvas.dblclick(position={"x": 30, "y": 30})
    until(page, lambda: close(eye(), first, 1e-6))


def test_a_target_is_dragged_beside_another(page, see):
    kit = position(page, "KittingBox")
    drag(page, "GreenBox", [kit[0] + 0.125, kit[1] + 0.01], target=True)
    expect(see("task-words-GreenBox")).to_have_text("at the right of the kit")
    expect(see("task-saved")).to_have_text("Changed, and not saved yet.")
    beside = [kit[0] + 0.133, kit[1], kit[2] + 0.0525]
    until(page, lambda: close(position(page, "GreenBox", target=True), beside, 0.002))
    green = position(page, "GreenBox", target=True)
    expect(see("task-up-GreenBox")).to_have_value("0")
    drag(page, "YellowBox", green, target=True)  # and on top of that
    expect(see("task-words-YellowBox")).to_have_text("on top of GreenBox")


def test_a_target_is_set_by_dragging_the_box_itself(page, see):
    kit = position(page, "KittingBox")
    blue = position(page, "BlueBox")
    drag(page, "BlueBox", [kit[0] - 0.133, kit[1]], arranging="targets")
    expect(see("task-words-BlueBox")).to_have_text("at the left of the kit")
    until(page, lambda: exists(page, "BlueBox"))
    assert close(position(page, "BlueBox"), blue, 1e-6)  # where it starts is as before
    drag(page, "BlueBox", [kit[0] + 0.133, kit[1]], arranging="targets")
    expect(see("task-words-BlueBox")).to_have_text("at the right of the kit")


def test_changes_are_not_lost_unasked(page, see, server):
    see("task-remove-GreenBox").click()
    expect(see("task-saved")).to_have_text("Changed, and not saved yet.")
    choose(page, see, "pyramid", described="stack")
    say_no(page)
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    (server.folder / "tasks").mkdir(exist_ok=True)
    taken = server.folder / "tasks" / "taken.yaml"
    taken.write_text("extends: pyramid\nname: taken\n")
    see("task-name").fill("taken")
    see("task-save").click()
    say_no(page)
    assert load_task(taken).targets == load_task("pyramid").targets
    choose(page, see, "pyramid", described="stack")
    see("task-leave-yes").click()
    expect(see("task-description")).to_have_text(load_task("pyramid").description)


def test_edits_are_undone_and_redone_by_buttons_and_keys(page, see):
    expect(see("task-undo")).to_be_disabled()
    expect(see("unsaved-mark")).not_to_be_visible()
    see("task-remove-GreenBox").click()
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    expect(see("unsaved-mark")).to_be_visible()
    see("task-undo").click()
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")
    expect(see("unsaved-mark")).not_to_be_visible()
    see("tab-task").focus()
    page.keyboard.press("Control+Shift+z")
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    expect(see("task-redo")).to_be_disabled()
    page.keyboard.press("Control+z")
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")


def test_unsaved_changes_outlive_the_server(page, see, server):
    see("task-remove-GreenBox").click()
    expect(see("task-saved")).to_have_text("Changed, and not saved yet.")
    server.restart(page)
    page.goto(server.url)
    expect(see("notices")).to_contain_text("Your unsaved changes of stack were restored")
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    see("notice-discard").click()
    see("notice-discard-yes").click()
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")
    expect(see("notices")).to_have_text("")


def test_a_target_is_written_by_keyboard(page, see):
    at_rest(page)
    press_on(see("task-right-YellowBox"), "Control+A")
    page.keyboard.type("133")
    page.keyboard.press("Tab")
    expect(see("task-words-YellowBox")).to_have_text("at the right of the kit")
    expect(see("task-away-YellowBox")).to_be_focused()  # one goes on where one was
    kit = position(page, "KittingBox")
    until(page, lambda: close(position(page, "GreenBox", target=True), [kit[0] + 0.133, kit[1], kit[2] + 0.1525]))


def test_one_writes_on_while_a_number_is_taken(page, see):
    """The first number is computed with while the second is being written."""
    see("task-start").click()
    press_on(see("task-right-BlueBox"), "Control+A")
    page.keyboard.type("-200")
    page.keyboard.press("Tab")
    page.keyboard.press("Control+A")
    page.keyboard.type("-70", delay=30)
    page.keyboard.press("Enter")
    table = min(STACK.tables, key=lambda table: math.dist(table.position[:2], position(page, "BlueBox")[:2]))
    until(page, lambda: close(position(page, "BlueBox")[:2], [table.position[0] - 0.2, table.position[1] - 0.07]))
    for axis, value in (("right", -200), ("away", -70), ("up", 0)):
        expect(see(f"task-{axis}-BlueBox")).to_have_value(f"{value}")


def test_a_target_is_added_measured_from_elsewhere_and_removed(page, see):
    see("task-add-BlueBox").click()
    expect(see("task-words-BlueBox")).to_contain_text("on Table")
    choose_option(page, see("task-reference-BlueBox"), "GreenBox")
    expect(see("task-words-BlueBox")).to_have_text("on top of GreenBox")
    until(page, lambda: exists(page, "BlueBox"))
    see("task-remove-BlueBox").click()
    expect(see("task-words-BlueBox")).to_have_text("may be anywhere")
    until(page, lambda: not exists(page, "BlueBox"))


def test_the_beginning_is_arranged_and_saved(page, see, server):
    see("task-start").click()
    blue = position(page, "BlueBox")
    drag(page, "GreenBox", blue)
    expect(see("task-up-GreenBox")).to_have_value("100")
    until(page, lambda: close(position(page, "GreenBox"), [blue[0], blue[1], blue[2] + 0.1]))
    fill(page, see, "task-right-YellowBox", -200)
    fill(page, see, "task-away-YellowBox", 50)
    table = min(STACK.tables, key=lambda table: math.dist(table.position[:2], position(page, "YellowBox")[:2]))
    until(page, lambda: close(position(page, "YellowBox")[:2], [table.position[0] - 0.2, 0.05]))
    see("task-fixed").get_by_text("as shown now").click()
    expect(see("task-saved")).to_have_text("Changed, and not saved yet.")
    see("task-name").fill("tower")
    see("task-save").click()
    expect(see("task-saved")).to_have_text("Saved as tasks/tower.yaml")
    saved = load_task(server.folder / "tasks" / "tower.yaml")
    fixed = {place.object: place.position for place in saved.layout.fixed}
    assert close(fixed["GreenBox"], [fixed["BlueBox"][0], fixed["BlueBox"][1], fixed["BlueBox"][2] + 0.1])
    assert saved.targets == STACK.targets
    page.reload()  # every window shows what the studio has
    expect(page.get_by_test_id("task-name")).to_have_value("tower")
    choose(page, see, "stack")
    choose(page, see, "tower")
    at_rest(page)
    until(page, lambda: close(position(page, "GreenBox")[:2], blue[:2]))


def test_other_beginnings_are_drawn_and_the_kit_changes_tables(page, see):
    see("task-start").click()
    before = position(page, "YellowBox")
    see("task-random").click()
    until(page, lambda: not close(position(page, "YellowBox"), before))
    at_rest(page)
    kit = position(page, "KittingBox")
    table = next(table for table in STACK.tables if abs(table.position[0] - kit[0]) > 0.5)
    choose_option(page, see("task-kit"), table.name)
    until(page, lambda: close(position(page, "KittingBox")[:2], table.position[:2]))


def test_a_box_cannot_start_just_anywhere(page, see):
    see("task-start").click()
    for field, value, says in (
        ("task-right-BlueBox", 3000, "out of reach for BlueBox; put it over one of the tables"),
        ("task-up-BlueBox", 4000, "BlueBox would be too high, out of reach"),
        ("task-up-BlueBox", -50, "BlueBox would be inside Table"),
    ):
        before = see(field).input_value()
        fill(page, see, field, value)
        expect(see("message"), f"{value} in {field}").to_contain_text(says)
        expect(see(field), f"{value} in {field}").to_have_value(before)
        expect(see("task-saved")).to_have_text("")
    fill(page, see, "task-right-BlueBox", see("task-right-GreenBox").input_value())  # and not inside another
    until(page, lambda: abs(position(page, "BlueBox")[0] - position(page, "GreenBox")[0]) < 2e-3)
    fill(page, see, "task-away-BlueBox", see("task-away-GreenBox").input_value())
    expect(see("message")).to_contain_text("BlueBox would be inside GreenBox; put it beside or on top of it")


def test_what_is_dropped_off_the_tables_goes_back(page, see):
    see("task-start").click()
    before = position(page, "BlueBox")
    drag(page, "BlueBox", [0.5, before[1], 0])
    expect(see("message")).to_contain_text("there is no table there, out of reach for BlueBox")
    until(page, lambda: close(position(page, "BlueBox"), before))
    see("task-targets").click()
    target = position(page, "GreenBox", target=True)
    drag(page, "GreenBox", [0.5, -0.3, 0], target=True)
    expect(see("message")).to_contain_text("there is no table there, out of reach for GreenBox")
    until(page, lambda: close(position(page, "GreenBox", target=True), target))


def test_a_target_inside_another_or_in_the_air_is_refused(page, see):
    fill(page, see, "task-up-GreenBox", -40)
    expect(see("message")).to_contain_text("GreenBox would be inside YellowBox")
    expect(see("task-up-GreenBox")).to_have_value("0")
    fill(page, see, "task-up-GreenBox", 200)
    expect(see("message")).to_contain_text("GreenBox would hang in the air")
    expect(see("task-saved")).to_have_text("")


def test_a_broken_task_file_is_a_sentence(page, see, server):
    cup = "extends: stack\nname: broken\ntargets: [{object: Cup, position: [0, 0, 0], frame: base_link}]"
    path = server.folder / "tasks" / "broken.yaml"
    path.parent.mkdir(exist_ok=True)
    for content, says in (("targets: [", "is not valid YAML"), (cup, "no object 'Cup'"), ("- 1", "must be a mapping")):
        path.write_text(content)
        go(see, "evolve")
        go(see, "task")  # which lists the files again
        choose_option(page, see("task-choice"), "broken", stays=False)
        expect(see("message"), content).to_contain_text(says)
        expect(see("task-choice"), content).to_have_value("stack")
        expect(see("task-words-GreenBox"), content).to_have_text("on top of YellowBox")  # nothing is lost
        assert path.read_text() == content
    path.unlink()


def test_a_name_that_cannot_be(page, see, server):
    for name, says in (
        ("stack", "the task stack comes with the package"),
        ("../evil", "'../evil' cannot name a task; use letters, digits, _ and -; at most 64"),
        ("", "'' cannot name a task"),
    ):
        see("task-name").fill(name)
        see("task-save").click()
        expect(see("message"), name).to_contain_text(says)
    assert not (server.folder / "evil.yaml").exists()


def test_two_people_do_not_edit_at_once(page, see, window):
    other = window()
    look = other.get_by_test_id
    see("task-remove-GreenBox").click()
    expect(look("task-words-GreenBox")).to_have_text("may be anywhere")
    expect(look("holder-task")).to_contain_text("Another window on this computer has the task")
    look("task-add-GreenBox").click()
    expect(look("message")).to_contain_text("has the task; wait until")
    choose_option(other, look("task-choice"), "pyramid", stays=False)
    expect(look("task-choice")).to_have_value("stack")  # it shows what is edited, not what was chosen in vain
    go(see, "evolve")  # lets go
    expect(look("holder-task")).to_be_hidden()
    look("task-undo").click()
    expect(look("task-words-GreenBox")).to_have_text("on top of YellowBox")
