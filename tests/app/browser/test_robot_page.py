"""A person who tries a tree on the robot's twin: watches it, gets in its way, stops it, and looks back."""

import re

import pytest
from playwright.sync_api import expect

from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.render.offscreen import available
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.browser.axe import axe_script, grave_faults
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.menus import choose_option
from tests.helpers.browser.steps import go

pytest.importorskip("pinocchio")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(available() is not True, reason=f"the twin's camera needs a renderer: {available()}"),
]
TREE = parse_tree("""
Sequence
  move(YellowBox, (0, 0, 0.022), KittingBox)
  move(GreenBox, (0, 0, 0.04), YellowBox)
  move(BlueBox, (0, 0, 0.04), GreenBox)
""")
AXE = axe_script()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run, which the page opens when it starts."""
    folder = tmp_path_factory.mktemp("page")
    run = RunFolder.create(folder / "runs" / "stacked", RunConfig(load_task("yumi_stack"), GPConfig(), Settings()))
    run.save_tree(TREE, title="stacked")
    return folder


def place(see, share):
    """Where a place of the camera's picture is in the window, in shares of its size."""
    box = see("robot-camera").bounding_box()
    return box["x"] + share[0] * box["width"], box["y"] + share[1] * box["height"]


def insist(see, press, sentence):
    """Tells the person in the cell to do something, again while the robot's hand is in the way."""
    for _ in range(30):
        press()
        expect(see("robot-said")).to_have_text(
            re.compile(f"{re.escape(sentence)}|the robot's hand is at", re.IGNORECASE)
        )
        if see("robot-said").inner_text() == sentence:
            return
        see("robot-said").page.wait_for_timeout(1000)
    raise AssertionError(f"the robot's hand stays in the way of: {sentence}")


def test_a_tree_runs_on_the_twin_a_box_is_pushed_it_stops_and_is_looked_back_at(page, see, server, shoot):
    go(see, "robot")
    expect(see("robot-stop")).to_be_hidden()
    see("robot-start").click()
    expect(see("robot-stop")).to_be_visible()
    for name in ("robot-camera", "robot-cell"):
        page.wait_for_function(
            f"() => document.querySelector('[data-testid={name}] img')?.naturalWidth > 0", timeout=180_000
        )
    expect(see("robot-what")).to_have_text(re.compile(r"^\d+ s: "))
    expect(page.locator("[data-testid=robot-tree] [id='node-0']")).to_have_class(re.compile(r"\brunning\b"))
    insist(see, lambda: press_on(see("robot-push-BlueBox"), "Enter"), "A person pushes BlueBox.")
    page.mouse.move(*place(see, (0.5, 0.98)))
    page.mouse.down()
    page.mouse.move(*place(see, (0.5, 0.6)))
    page.mouse.up()
    expect(see("robot-said")).to_contain_text("There is no object at that place of the picture")
    shoot("robot")
    if AXE is not None:
        page.emulate_media(reduced_motion="reduce")
        assert grave_faults(page, AXE) == []
    insist(see, see("robot-remove-BlueBox").click, "A person takes BlueBox away.")
    expect(see("robot-seen-BlueBox")).to_have_text("taken away")
    expect(see("robot-push-BlueBox")).to_be_hidden()
    insist(see, see("robot-return-BlueBox").click, "A person brings BlueBox back.")
    go(see, "task")
    see("robot-stop").click()  # it is there in every step
    expect(see("robot-bar")).to_be_hidden()
    go(see, "robot")
    expect(see("robot-what")).to_have_text("Stopped: the arms rest.")
    expect(see("robot-start")).to_be_enabled()
    (log,) = (server.folder / "logs").glob("*.jsonl")
    see("robot-back").locator(".q-item").first.click()
    choose_option(page, see("robot-log"), log.stem)
    expect(see("robot-cell")).to_be_visible()
    expect(see("robot-camera")).to_be_hidden()
    for _ in range(100):
        if "End:" in see("robot-what").inner_text():
            break
        press_on(see("robot-timeline").locator("[tabindex]"), "PageUp")
        page.wait_for_timeout(100)
    expect(see("robot-what")).to_contain_text("End: interrupted")


def test_the_real_robot_is_prepared(page, see):
    go(see, "robot")
    see("robot-real").locator(".q-item").first.click()
    expect(see("robot-why")).to_contain_text("The real robot is run from the command line only.")
    see("robot-check").click()
    expect(see("robot-items").locator("li")).to_have_count(17)
    expect(see("robot-items")).to_contain_text("did not succeed; look into it with replay and fix the tree.")
    expect(see("robot-commands")).to_contain_text("python -m bt_jax.deploy check ")


def test_a_task_too_large_for_the_robot_has_a_version_for_it(page, see):
    go(see, "task")
    choose_option(page, see("task-choice"), "kit4")
    go(see, "robot")
    expect(see("robot-refusal")).to_contain_text("mm wide, and the grippers of yumi open 50 mm")
    expect(see("robot-start")).to_be_disabled()
    see("robot-other-task").click()
    expect(see("message")).to_have_text("yumi_kit4 is open: find a tree for it, then come back to step 7.")
