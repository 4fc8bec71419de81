"""Whatever the size of the window, whatever the names: every button is in its place and takes the click."""

import dataclasses

import numpy as np
import pytest
from playwright.sync_api import expect

from bt_jax.app.state.steps import STEPS
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.browser.steps import go
from tests.helpers.browser.words import banned_texts

pytestmark = pytest.mark.slow

SIZES = ((1920, 1080), (1280, 720), (1024, 768), (640, 360), (390, 844))
NAMES = {640: "zoomed"}  # 1280 x 720, twice as large
IN_FULL = (1280, 640, 390)  # widths at which dialogs, the gripper and messages are looked at, too
LONG = "W" * 64
PUT = "move({}, ({}, 0, 0.055), KittingBox)"
WIDE = ", ".join(f"Sequence({PUT.format('YellowBox', i / 99)}, {PUT.format('GreenBox', i / 98)})" for i in range(12))

# What is wrong with the visible buttons: those whose middle is outside their panel, or that something else covers.
MISPLACED = """() => {
  const wrong = [];
  const asked = document.querySelectorAll(".q-dialog .q-card");
  const parts = ".page-header, .notices, .scene-views, .page-panel, .next-bar, .page-footer";
  const areas = asked.length ? asked : document.querySelectorAll(parts);
  for (const area of areas) {
    if (!area.checkVisibility()) continue;
    if (area.scrollWidth > area.clientWidth + 1) wrong.push(`${area.className} is wider than it is shown`);
    for (const button of area.querySelectorAll("button, [role=tab], [role=radio], [role=checkbox]")) {
      if (!button.checkVisibility({ visibilityProperty: true }) || button.offsetWidth === 0) continue;
      button.scrollIntoView({ block: "nearest", inline: "nearest" });
      const { x, y, width, height } = button.getBoundingClientRect();
      const [across, down] = [x + width / 2, y + height / 2];
      const room = area.getBoundingClientRect();
      const name = button.dataset.testid || button.ariaLabel || button.innerText;
      if (across < room.left || across > room.right || down < room.top || down > room.bottom) {
        wrong.push(`${name} is outside`);
      } else if (!button.contains(document.elementFromPoint(across, down))) {
        wrong.push(`${name} is covered by ${document.elementFromPoint(across, down)?.outerHTML.slice(0, 120)}`);
      }
    }
  }
  return wrong;
}"""


def misplaced(page):
    """What is wrong with the visible buttons once what opens or closes has come to rest."""
    for _ in range(100):
        found = page.evaluate(MISPLACED)
        if not found:
            break
        page.wait_for_timeout(100)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run with a wide tree and long names, and demonstrations with long names."""
    folder = tmp_path_factory.mktemp("page")
    task = dataclasses.replace(load_task("stack3"), name=LONG)
    run = RunFolder.create(folder / "runs" / LONG, RunConfig(task, GPConfig(), Settings()))
    run.save_tree(parse_tree(f"Fallback({WIDE})"), title=LONG)
    on_yellow = Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox")
    shown = demonstration_set(task, [on_yellow], count=3, rng=np.random.default_rng(0), noise=0.003)
    demonstrations = DemonstrationFolder(folder / "demonstrations" / "demonstrations")
    demonstrations.create(shown.frames)
    for one in shown.demonstrations:
        demonstrations.append(one)
    demonstrations.rename("demo1", LONG)
    return folder


def test_every_button_is_in_its_place_at_every_size(page, see, shoot):
    see("task-remove-BlueBox").click()  # the banner says so
    expect(see("banner-text")).to_contain_text(LONG)
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for step in STEPS:
            go(see, step)
            if (step, width) == ("keep", SIZES[0][0]):
                see("keep-runs").get_by_role("row", name=LONG).get_by_role("checkbox").click()
                expect(see("keep-tree-0").locator("svg")).to_be_visible()
            assert misplaced(page) == [], (width, step)
            shoot(f"{NAMES.get(width, width)}_{step}")
        if width not in IN_FULL:
            continue
        see("keep-delete").click()
        expect(see("keep-delete-yes")).to_be_visible()
        assert misplaced(page) == [], (width, "a question")
        page.get_by_role("button", name="Cancel").click()
        expect(page.locator(".q-dialog")).to_have_count(0)
        go(see, "demonstrate")
        see("demonstrate-new").click()
        expect(see("demonstrate-finish")).to_be_visible()
        assert misplaced(page) == [], (width, "the gripper")
        see("demonstrate-discard").click()
        expect(see("demonstrate-new")).to_be_visible()
        go(see, "task")
        see("task-name").fill(5 * LONG)
        see("task-save").click()
        expect(see("message")).to_contain_text("cannot name a task; use letters, digits, _ and -; at most 64")
        assert misplaced(page) == [], (width, "a long message")
        see("task-start").click()
        expect(see("task-random")).to_be_visible()
        assert misplaced(page) == [], (width, "where boxes start")
        see("task-targets").click()


def test_the_words_are_those_of_the_shop_floor(page, see):
    found = {}
    for step in STEPS:
        go(see, step)
        if step == "understand":
            expect(see("understand-action-2")).to_be_visible()
        found[step] = banned_texts(page)
    go(see, "demonstrate")
    see("demonstrate-new").click()
    expect(see("demonstrate-finish")).to_be_visible()
    found["the gripper"] = banned_texts(page)
    see("demonstrate-discard").click()
    expect(see("demonstrate-new")).to_be_visible()
    assert {where: texts for where, texts in found.items() if texts} == {}


def test_a_message_is_that_of_its_window_and_goes_with_the_next_success(window, page, see, server):
    other = window()
    go(see, "task")
    see("task-name").fill("not/a/name")
    see("task-save").click()
    expect(see("message")).to_contain_text("'not/a/name' cannot name a task")
    expect(see("message")).to_have_attribute("role", "alert")
    see("task-name").fill("fine")
    see("task-save").click()
    expect(see("message")).to_have_text("The task is saved as fine.")
    expect(other.get_by_test_id("task-saved")).to_have_text("Saved as tasks/fine.yaml")
    expect(other.get_by_test_id("message")).to_have_text("")
    (server.folder / "tasks" / "fine.yaml").write_text("targets: [")
    see("task-remove-GreenBox").click()
    see("task-revert").click()
    expect(see("message")).to_contain_text("tasks/fine.yaml, line")
    expect(see("message")).not_to_contain_text(str(server.folder))
