"""A person who demonstrates, looks at what was understood, and knows better."""

import dataclasses
import re
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from playwright.sync_api import expect

from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.lfd import Corrections, DemonstrationFolder, Frames, learn
from bt_jax.lfd.evaluation.synthetic import demonstrate as shown
from bt_jax.tasks import Target, load_task
from tests.helpers.browser.gripper import carry, position, press, said, set_step
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.scene import click
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


@pytest.fixture(autouse=True)
def demonstrate(request, server, page, see):
    """Every test has a set of its own, and begins at step 3 with no demonstration in the making."""
    name = re.sub(r"\W+", "_", request.node.name)[:40]
    go(see, "demonstrate")
    see("demonstrate-new-set").click()
    see("demonstrate-new-set-name").fill(name)
    page.keyboard.press("Enter")
    expect(see("demonstrate-progress")).to_contain_text("No demonstration yet; 3 are needed")
    expect(see("demonstrate-set")).to_have_value(name)
    yield DemonstrationFolder(server.folder / "demonstrations" / name)
    if see("demonstrate-discard").is_visible():
        recorded = see("demonstrate-done").locator("li").count() > 0
        see("demonstrate-discard").click()
        if recorded:
            see("demonstrate-discard-yes").click()
        expect(see("demonstrate-new")).to_be_visible()


def begin(page, see, number="2"):
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    page.keyboard.press(number)
    expect(see("demonstrate-pose-KittingBox-z")).to_be_visible()
    set_step(page, see, 20)  # a step outlives a demonstration


def test_three_demonstrations_by_keyboard_only(page, see, demonstrate):
    expected = [
        "1 of 3 demonstrations: 2 more will tell",
        "2 of 3 demonstrations: 1 more will tell",
        "3 demonstrations: enough to tell",
    ]
    for number, sentence in enumerate(expected, start=1):
        press_on(see("demonstrate-new"), "Enter")
        expect(see("demonstrate-finish")).to_be_visible()
        page.keyboard.press("2")
        expect(see("demonstrate-done")).to_contain_text("Pick up GreenBox")
        carry(page, see, (0.0, 0.0, 120.0), "YellowBox")
        expect(see("demonstrate-landing")).to_contain_text("GreenBox is set down on YellowBox")
        page.keyboard.press("r")
        expect(see("demonstrate-done")).to_contain_text("Put GreenBox on top of YellowBox")
        press_on(see("demonstrate-finish"), "Enter")
        expect(see("demonstrate-progress")).to_contain_text(sentence)
        expect(see("message")).to_contain_text(f"demo{number} is kept")
    assert page.evaluate("document.scrollingElement.scrollTop") == 0
    lesson = demonstrate.read()
    assert [len(one.actions) for one in lesson] == [2, 2, 2]
    info = yaml.safe_load((demonstrate.path / "info.yaml").read_text())
    assert info["task"] == "stack"
    go(see, "understand")
    expect(see("understand-action-2")).to_contain_text("Set down GreenBox on top of YellowBox")
    expect(see("understand-action-2")).to_contain_text("in 3 of 3 demonstrations")
    expect(see("understand-clear")).to_contain_text("Nothing is open")
    see("understand-why-2").get_by_text("Why?").click()
    expect(see("understand-reason-2")).to_contain_text("in YellowBox")
    expect(see("understand-frame-2-YellowBox")).to_have_attribute("aria-pressed", "true")
    expect(see("understand-frame-2-YellowBox").locator("circle")).to_have_count(3)
    expect(see("understand-goal-1")).to_contain_text("GreenBox is on top of YellowBox")
    expect(see("understand-tree")).to_contain_text("Put GreenBox on")
    press_on(see("understand-frame-2-KittingBox"), "Enter")
    expect(see("understand-frame-2-KittingBox")).to_have_attribute("aria-pressed", "true")
    expect(see("understand-frame-2-KittingBox")).to_be_focused()
    expect(see("understand-reason-2")).to_contain_text("Chosen by hand; the demonstrations alone say YellowBox")
    expect(see("understand-tree")).not_to_contain_text("YellowBox")
    assert set(demonstrate.read().corrections.frames.values()) == {"KittingBox"}
    see("understand-auto-2").click()
    expect(see("understand-frame-2-YellowBox")).to_have_attribute("aria-pressed", "true")
    assert demonstrate.read().corrections.frames == {}
    with page.expect_download() as download:
        see("understand-xml").click()
    assert from_xml(Path(download.value.path()).read_text()) == learn(demonstrate.read(), load_task("stack")).tree
    see("understand-combine").click()
    expect(see("combine-taught")).to_contain_text("This tree, from 3 demonstrations")
    expect(see("combine-targets")).to_contain_text("GreenBox on top of YellowBox (changed)")
    see("combine-use").get_by_text("It is a step on the way").click()
    expect(see("combine-targets")).to_contain_text("on the way, once: GreenBox is on top of YellowBox")
    expect(see("combine-state")).to_contain_text("Nothing has been evolved yet: start in step 2")
    expect(see("combine-go")).to_be_disabled()


def test_the_buttons_do_what_the_keys_do(page, see):
    see("demonstrate-new").click()
    see("demonstrate-pick-GreenBox").click()
    expect(see("demonstrate-pose-KittingBox-z")).to_be_visible()
    set_step(page, see, 20)
    for name, axis, sign in (
        ("right", "x", 1), ("left", "x", -1), ("away", "y", 1), ("near", "y", -1), ("up", "z", 1), ("down", "z", -1)
    ):  # fmt: skip
        before = position(see, "base_link", axis)
        see(f"demonstrate-{name}").click()
        expect(see(f"demonstrate-pose-base_link-{axis}")).to_have_text(said(before + 20 * sign))
    # A button that was clicked has the focus: keys still carry, and do not click it again.
    before = position(see, "base_link", "z")
    press(page, see, "PageUp", 2, frame="base_link", axis="z", sign=1, step=20)
    expect(see("demonstrate-pose-base_link-turn")).to_have_text("0°")
    see("demonstrate-over-YellowBox").click()
    expect(see("demonstrate-pose-YellowBox-x")).to_have_text(said(0))
    expect(see("demonstrate-landing")).to_contain_text("is set down on YellowBox")
    see("demonstrate-release").click()
    expect(see("demonstrate-done")).to_contain_text("Put GreenBox on top of YellowBox")


def test_who_types_does_not_move_the_gripper(page, see):
    begin(page, see)
    before = position(see, "base_link", "x")
    see("demonstrate-step").fill("70")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Enter")
    press(page, see, "ArrowRight", 1, frame="base_link", axis="x", sign=1, step=70)
    assert position(see, "base_link", "x") == pytest.approx(before + 70, abs=2)
    see("demonstrate-step").fill("0")
    see("demonstrate-step").evaluate("field => field.blur()")
    expect(see("message")).to_contain_text("the step must be from 1 to 500 mm; choose another")
    expect(see("demonstrate-step")).to_have_value("70")


def test_undo_takes_back_one_action_after_the_other(page, see):
    begin(page, see)
    start = position(see, "base_link", "z")
    press(page, see, "PageUp", 3, frame="base_link", axis="z", sign=1, step=20)
    see("demonstrate-over-YellowBox").click()
    expect(see("demonstrate-pose-YellowBox-x")).to_have_text(said(0))
    page.keyboard.press("r")
    expect(see("demonstrate-done").locator("li")).to_have_count(2)
    page.keyboard.press("Control+z")
    expect(see("demonstrate-done").locator("li")).to_have_count(1)
    expect(see("demonstrate-pose-YellowBox-x")).to_have_text(said(0))
    see("demonstrate-undo").click()
    expect(see("demonstrate-pose-base_link-z")).to_have_text(said(start))
    page.keyboard.press("Control+z")
    expect(see("demonstrate-done").locator("li")).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(see("message")).to_contain_text("nothing can be undone; pick an object")


def test_what_cannot_be_done_is_said_and_nothing_is_lost(page, see, demonstrate):
    begin(page, see)
    see("demonstrate-finish").click()
    expect(see("message")).to_contain_text("the gripper still holds GreenBox; release it, then finish")
    carry(page, see, (0.0, 0.0, 40.0), "YellowBox")
    expect(see("demonstrate-landing")).to_contain_text("GreenBox is inside YellowBox: raise it, or carry it aside")
    page.keyboard.press("r")
    expect(see("message")).to_contain_text("GreenBox would be inside YellowBox; raise it or carry it aside")
    carry(page, see, (500.0, -1000.0, 900.0), "base_link")
    expect(see("demonstrate-landing")).to_contain_text("only the floor")
    page.keyboard.press("r")
    expect(see("message")).to_contain_text(
        "GreenBox would fall to the floor, out of the gripper's reach; carry GreenBox over"
    )
    page.keyboard.press("1")
    expect(see("message")).to_contain_text("the gripper holds GreenBox; release it before you pick YellowBox")
    see("demonstrate-over-KittingBox").click()
    expect(see("demonstrate-landing")).to_contain_text("is set down on KittingBox")
    page.keyboard.press("r")
    expect(see("demonstrate-done")).to_contain_text("Put GreenBox in the middle of the kit")
    see("demonstrate-finish").click()
    expect(see("demonstrate-progress")).to_contain_text("1 of 3")
    assert len(demonstrate.read()) == 1


def test_a_discarded_demonstration_leaves_nothing(page, see, demonstrate):
    begin(page, see)
    see("demonstrate-discard").click()
    page.get_by_role("button", name="Cancel").click()
    expect(see("demonstrate-pose-KittingBox-z")).to_be_visible()
    see("demonstrate-discard").click()
    see("demonstrate-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()
    expect(see("demonstrate-progress")).to_contain_text("No demonstration yet")
    assert not demonstrate.path.exists()


def test_a_box_that_is_clicked_is_picked_and_a_reload_loses_nothing(page, see):
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    click(page, "BlueBox")
    expect(see("demonstrate-done")).to_contain_text("Pick up BlueBox")
    page.reload()
    go(see, "demonstrate")
    expect(see("demonstrate-done")).to_contain_text("Pick up BlueBox")
    expect(see("demonstrate-pose-KittingBox-z")).to_be_visible()


def test_a_killed_server_loses_nothing(page, see, server):
    begin(page, see)
    see("demonstrate-over-YellowBox").click()
    expect(see("demonstrate-pose-YellowBox-x")).to_have_text(said(0))
    page.keyboard.press("r")
    expect(see("demonstrate-done")).to_contain_text("Put GreenBox on top of YellowBox")
    page.keyboard.press("3")
    expect(see("demonstrate-done")).to_contain_text("Pick up BlueBox")
    see("demonstrate-up").focus()
    draft = server.folder / "demonstration_draft.json"
    end = time.monotonic() + 180
    while not (draft.is_file() and "BlueBox" in draft.read_text().rpartition("inputs")[2]):
        assert time.monotonic() < end, "the last input is not kept"
        page.wait_for_timeout(50)
    server.kill()
    expect(page.locator("#popup")).to_be_visible()
    expect(page.locator("body")).to_have_class(re.compile("offline"))
    assert page.evaluate("document.querySelector('.page').closest('[inert]') !== null")
    assert page.evaluate("document.activeElement === document.body")
    server.start()
    expect(see("notices")).to_contain_text("The demonstration in the making was restored, with 3 actions")
    expect(page.locator("body")).not_to_have_class(re.compile("offline"))
    expect(see("demonstrate-done")).to_contain_text("Pick up BlueBox")
    expect(see("demonstrate-pose-KittingBox-z")).to_be_visible()
    see("notice-discard").click()
    see("notice-discard-yes").click()
    expect(see("demonstrate-new")).to_be_visible()
    expect(see("notices")).to_have_text("")


def test_controls_come_back_with_the_connection(page, see):
    see("demonstrate-new-set").focus()
    page.evaluate("document.getElementById('popup').ariaHidden = false")  # as NiceGUI does once the connection is lost
    expect(page.locator("body")).to_have_class(re.compile("offline"))
    assert page.evaluate("document.querySelector('.page').closest('[inert]') !== null")
    page.evaluate("document.getElementById('popup').ariaHidden = true")
    expect(page.locator("body")).not_to_have_class(re.compile("offline"))
    expect(see("demonstrate-new-set")).to_be_focused()


def test_renamed_replayed_and_deleted(page, see, demonstrate):
    for _ in range(2):
        begin(page, see, "3")
        see("demonstrate-over-KittingBox").click()
        expect(see("demonstrate-landing")).to_contain_text("is set down on KittingBox")
        page.keyboard.press("r")
        expect(see("demonstrate-done").locator("li")).to_have_count(2)
        see("demonstrate-finish").click()
        expect(see("demonstrate-new")).to_be_visible()
    first = see("demonstrate-row-demo1")
    first.get_by_role("button", name="Rename demo1").click()
    see("demonstrate-rename-name").fill("demo2")
    see("demonstrate-rename-yes").click()
    expect(see("message")).to_contain_text("exists already; choose another name")
    first.get_by_role("button", name="Rename demo1").click()
    see("demonstrate-rename-name").fill("into the kit")
    see("demonstrate-rename-yes").click()
    renamed = see("demonstrate-row-into the kit")
    expect(renamed).to_be_visible()
    assert demonstrate.names() == ["into the kit", "demo2"]
    page.evaluate(
        """() => {
            const label = document.querySelector("[data-testid=message]");
            window.said = [];
            new MutationObserver(() => window.said.push(label.innerText)).observe(
                label, { childList: true, characterData: true, subtree: true });
        }"""
    )
    renamed.get_by_role("button", name="Replay").click()
    expect(see("message")).to_contain_text("into the kit, 2 of 2: Put BlueBox in the middle of the kit")
    assert "into the kit, 1 of 2: Pick up BlueBox" in page.evaluate("window.said")
    expect(renamed.get_by_role("button", name="Replay")).to_be_visible()
    see("demonstrate-row-demo2").get_by_role("button", name="Delete demo2").click()
    page.get_by_role("button", name="Cancel").click()
    assert demonstrate.names() == ["into the kit", "demo2"]
    see("demonstrate-row-demo2").get_by_role("button", name="Delete demo2").click()
    see("demonstrate-delete-yes").click()
    expect(see("demonstrate-row-demo2")).to_have_count(0)
    expect(see("demonstrate-progress")).to_contain_text("1 of 3")
    assert demonstrate.names() == ["into the kit"]


def test_a_damaged_demonstration_is_listed_with_the_reason(page, see, demonstrate):
    begin(page, see, "3")
    see("demonstrate-over-KittingBox").click()
    expect(see("demonstrate-landing")).to_contain_text("is set down on KittingBox")
    page.keyboard.press("r")
    expect(see("demonstrate-done").locator("li")).to_have_count(2)
    see("demonstrate-finish").click()
    expect(see("demonstrate-row-demo1")).to_be_visible()
    (demonstrate.path / "demo1" / "data_2.yaml").write_text("type: [")
    page.reload()
    go(see, "demonstrate")
    expect(see("demonstrate-row-demo1")).to_contain_text("data_2.yaml, line 1 is not valid YAML")
    expect(see("demonstrate-row-demo1").get_by_role("button", name="Replay")).to_be_disabled()
    go(see, "understand")
    expect(see("understand-problem")).to_contain_text("data_2.yaml, line 1 is not valid YAML")


def test_two_windows_show_one_demonstration_that_one_of_them_steers(window, page, see):
    other = window()
    look = other.get_by_test_id
    go(look, "demonstrate")
    begin(page, see)
    expect(look("demonstrate-done")).to_contain_text("Pick up GreenBox")
    expect(look("holder-gripper")).to_contain_text("Another window on this computer has the gripper")
    expect(see("holder-gripper")).to_be_hidden()
    before = position(see, "KittingBox", "z")
    other.keyboard.press("PageUp")
    other.evaluate("emitEvent('teach_key', {key: 'PageUp', repeat: false})")  # as a page might that was changed
    expect(look("message")).to_contain_text("has the gripper; wait until")
    press(page, see, "PageUp", 1, frame="KittingBox", axis="z", sign=1, step=20)
    expect(look("demonstrate-pose-KittingBox-z")).to_have_text(said(before + 20))
    go(see, "task")  # lets go
    expect(look("holder-gripper")).to_be_hidden()
    press(other, look, "PageUp", 1, frame="KittingBox", axis="z", sign=1, step=20)
    go(see, "demonstrate")
    expect(see("holder-gripper")).to_contain_text("Another window on this computer has the gripper")
    expect(see("demonstrate-pose-KittingBox-z")).to_have_text(said(before + 40))
    other.context.close()
    expect(see("holder-gripper")).to_be_hidden()


def test_what_is_open_is_asked_and_settled(page, see, demonstrate, shoot):
    """The kit stood on one table each time: is GreenBox's place in the kit, or a fixed one?"""
    task = load_task("stack")
    left = dataclasses.replace(task, layout=dataclasses.replace(task.layout, kit=task.tables[0].name))
    demonstrate.create(Frames.of(task))
    place = Target("GreenBox", (0.0, 0.0, 0.0525), "KittingBox")
    for number in range(3):
        demonstrate.append(shown(left, [place], rng=np.random.default_rng(number)))
    go(see, "task")
    go(see, "demonstrate")  # reads what is there
    expect(see("demonstrate-progress")).to_contain_text("3 demonstrations: enough")
    go(see, "understand")
    question = see("understand-question-1")
    expect(question).to_contain_text(
        "Should GreenBox follow its place in the kit, or stay at a fixed place?", timeout=60_000
    )
    expect(question.locator("img")).to_have_count(2)
    shoot("understand")
    taken = see("understand-tree").inner_text()
    press_on(see("understand-answer-1-2"), "Enter")
    expect(see("understand-answered-1")).to_have_text("GreenBox stays at a fixed place.")
    expect(see("understand-clear")).to_be_visible(timeout=60_000)
    expect(see("understand-tree")).not_to_have_text(taken)
    assert set(demonstrate.read().corrections.frames.values()) == {"base_link"}
    see("understand-take-back-1").click()
    expect(question).to_be_visible(timeout=60_000)
    assert demonstrate.read().corrections == Corrections()
    see("understand-propose").click()
    expect(see("demonstrate-finish")).to_be_visible(timeout=60_000)
    expect(see("message")).to_contain_text("Start with")
    expect(see("message")).not_to_contain_text(f"the kit on {task.tables[0].name}")
