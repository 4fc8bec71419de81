"""A person who watches a tree at work: plays, holds, steps, looks back, unfolds it, and gets in its way."""

import math
import re

import pytest
from playwright.sync_api import expect

from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.menus import choose_option
from tests.helpers.browser.scene import COMPONENT, at_rest, drag, position
from tests.helpers.browser.steps import go

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def options():
    """A window keeps what it has for as long as a test lasts, on a busy machine, too."""
    return ("--hold-factor", "1000")


STACK = load_task("stack")
TREE = parse_tree("""
Sequence
  move(YellowBox, (0, 0, 0.055), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
""")
LEVELS = """
Sequence
  Fallback
    Sequence
      Fallback
        gripper(open)
        open_gripper
      move(YellowBox, (0, 0, 0.055), KittingBox)
    Sequence
      Fallback
        gripper(closed)
        close_gripper
      move(GreenBox, (0, 0, 0.1), YellowBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
  move(BlueBox, (0, 0, 0.1), GreenBox)
"""


@pytest.fixture(scope="module", autouse=True)
def runs(server):
    """Two runs that there are before the page is opened."""
    for name, tree in (("stacked", TREE), ("large", parse_tree(LEVELS))):
        folder = RunFolder.create(server.folder / "runs" / name, RunConfig(STACK, GPConfig(), Settings()))
        folder.save_tree(tree, title=name)


@pytest.fixture(autouse=True)
def begun(page, see):
    """Every test begins with the tree of a run in the first layout, at four times the pace."""
    go(see, "run")
    choose(page, see, "stacked")
    expect(see("run-what")).to_have_text("The beginning: press Play.")
    pace(page, see, "4")
    at_rest(page)


def pace(page, see, times):
    choose_option(page, see("run-speed"), f"{times} \N{MULTIPLICATION SIGN}")
    expect(see("run-speed")).to_have_value(re.compile(times))


def choose(page, see, name):
    """Takes the tree of a run, from its beginning."""
    if see("run-source").input_value() != name:
        choose_option(page, see("run-source"), name)
    expect(see("run-tree")).to_contain_text("Do all")
    see("run-restart").click()


def node(page, number):
    return page.locator(f"[data-testid=run-tree] [id='node-{number}']")


def has(page, number, status):
    expect(node(page, number)).to_have_class(re.compile(rf"\b{status}\b"))


def play_to_the_end(see):
    see("run-play").click()
    expect(see("run-verdict")).to_have_text("The tree says that it is done. Everything is where it should be.")
    expect(see("run-play")).to_contain_text("Play")


def test_it_plays_to_the_end_and_one_can_look_back(page, see):
    has(page, 0, "idle")
    play_to_the_end(see)
    for number in range(3):
        has(page, number, "success")
    at_rest(page)
    yellow, green, kit = (position(page, name) for name in ("YellowBox", "GreenBox", "KittingBox"))
    assert math.dist(yellow[:2], kit[:2]) < 0.03
    assert math.dist(green, [*yellow[:2], yellow[2] + 0.1]) < 0.03
    handle = see("run-timeline").locator("[tabindex]")
    for tick in reversed(range(moments(see))):
        press_on(handle, "ArrowLeft")
        expect(see("run-timeline")).to_have_attribute("aria-valuenow", str(tick))
        expect(see("run-what")).to_contain_text(f"Tick {tick}" if tick else "The beginning")
    expect(see("run-what")).to_have_text("The beginning: press Play.")
    has(page, 0, "idle")
    page.keyboard.press("ArrowRight")
    expect(see("run-what")).to_have_text("Tick 1: Pick up YellowBox")
    has(page, 1, "running")
    has(page, 2, "idle")
    for tick in range(2, moments(see) + 1):
        page.keyboard.press("ArrowRight")
        expect(see("run-what")).to_contain_text(f"Tick {tick}")
    expect(see("run-verdict")).to_contain_text("Everything is where it should be.")


def test_single_ticks_show_what_happens_and_the_gripper_carries_the_box(page, see):
    pace(page, see, "0.5")
    see("run-tick").click()
    expect(see("run-what")).to_have_text("Tick 1: Pick up YellowBox")
    at_rest(page)
    page.evaluate(f"""() => {{ {COMPONENT}
      window.seen = [];
      const draw = c.place.bind(c);
      c.place = (state) => {{
        draw(state);
        seen.push([...state.objects[0].slice(0, 3), ...state.gripper.slice(0, 3)]);
      }};
    }}""")
    see("run-tick").click()
    expect(see("run-what")).to_have_text("Tick 2: Set down YellowBox in the middle of the kit")
    page.wait_for_function(f"""() => {{ {COMPONENT}
      return c.bodies.YellowBox.position.distanceTo(c.bodies.KittingBox.position) < 0.07;
    }}""")
    at_rest(page)
    seen = page.evaluate("seen")
    carried = [row for row in seen if math.dist(row[:3], row[3:]) < 0.005]
    assert len({tuple(row) for row in carried}) >= 3  # however slow the machine, the way is seen
    assert max(row[2] for row in carried) > seen[0][2] + 0.05  # in an arc
    see("run-tick").click()
    expect(see("run-what")).to_have_text("Tick 3: Pick up GreenBox")
    has(page, 1, "success")
    has(page, 2, "running")


def test_it_is_held_in_mid_motion_and_goes_on(page, see):
    pace(page, see, "0.5")
    see("run-play").click()
    expect(see("run-what")).to_have_text("Tick 1: Pick up YellowBox")
    see("run-play").click()
    expect(see("run-play")).to_contain_text("Play")
    page.wait_for_function(f"() => {{ {COMPONENT} return !c.motion; }}")
    held = page.evaluate(f"() => {{ {COMPONENT} return c.gripper; }}")
    page.wait_for_timeout(300)
    assert page.evaluate(f"() => {{ {COMPONENT} return c.gripper; }}") == held
    pace(page, see, "4")
    play_to_the_end(see)


def moments(see):
    """How many moments there are to look at."""
    return int(see("run-timeline").get_attribute("aria-valuemax"))


def reacted(see, seen):
    """A box was moved after so many moments, and has been put back since."""
    expect(see("run-timeline")).not_to_have_attribute("aria-valuemax", str(seen))
    expect(see("run-play")).to_contain_text("Play")
    expect(see("run-verdict")).to_contain_text("Everything is where it should be.")
    assert moments(see) >= seen + 4  # moved, picked up, set down, and done


def test_the_tree_reacts_to_a_box_that_is_dragged_away(page, see):
    play_to_the_end(see)
    at_rest(page)
    kit = position(page, "KittingBox")
    table = next(table for table in STACK.tables if abs(table.position[0] - kit[0]) > 0.5)
    seen = moments(see)
    drag(page, "GreenBox", [table.position[0] - 0.2, table.position[1] - 0.2])
    reacted(see, seen)
    at_rest(page)
    assert math.dist(position(page, "GreenBox")[:2], kit[:2]) < 0.05


def test_a_box_is_moved_by_numbers(page, see):
    play_to_the_end(see)
    choose_option(page, see("run-box"), "GreenBox")
    see("run-right-GreenBox").fill("3000")
    page.keyboard.press("Enter")
    expect(see("message")).to_contain_text("out of reach for GreenBox")
    seen = moments(see)
    choose_option(page, see("run-reference-GreenBox"), free_table(page), stays=False)  # for long
    reacted(see, seen)


def free_table(page):
    """A table on which neither the kit nor a box stands."""
    taken = [position(page, name)[0] for name in ("KittingBox", *STACK.object_names)]
    return next(table.name for table in STACK.tables if min(abs(table.position[0] - x) for x in taken) > 0.4)


def test_what_cannot_be_is_said_and_the_run_goes_on(page, see):
    blue = position(page, "BlueBox")
    drag(page, "BlueBox", [0.5, blue[1]])
    expect(see("message")).to_contain_text("there is no table there, out of reach for BlueBox")
    see("run-tick").click()
    expect(see("run-what")).to_have_text("Tick 1: Pick up YellowBox")
    at_rest(page)
    drag(page, "YellowBox", blue)
    expect(see("message")).to_contain_text("YellowBox is in the gripper; wait until the robot has put it down")
    play_to_the_end(see)
    at_rest(page)
    assert math.dist(position(page, "BlueBox"), blue) < 0.01


def test_nodes_are_in_words_and_unfold(page, see):
    assert " ".join(node(page, 1).locator("text").all_text_contents()) == "Put YellowBox in the middle of the kit +10"
    expect(node(page, 1).locator("title")).to_contain_text("move(YellowBox, (0, 0, 0.055), KittingBox)")
    expect(node(page, "1-1")).to_have_count(0)
    press_on(node(page, 1), "Enter")
    expect(node(page, "1-1")).to_contain_text("Is YellowBox in")
    see("run-tick").click()
    has(page, "1-1", "failure")
    see("run-tree-symbols").click()
    expect(node(page, "1-1")).to_contain_text("at(YellowBox,")
    has(page, "1-1", "failure")
    see("run-tree-fold").click()
    expect(node(page, "1-1")).to_have_count(0)
    see("run-tree-symbols").click()
    expect(node(page, 1)).to_contain_text("Put YellowBox")


def test_a_large_tree_begins_folded(page, see):
    choose(page, see, "large")
    expect(see("run-tree")).to_contain_text("BlueBox")  # which the tree before has nothing to do with
    expect(node(page, 2)).to_contain_text("+")
    expect(node(page, 3)).to_have_count(0)
    node(page, 2).click()
    expect(node(page, 3)).to_contain_text("Try in turn")
    see("run-tree-unfold").click()
    expect(node(page, "6-10")).to_have_count(1)


def test_two_windows_show_the_same_run(page, see, window):
    other = window()
    go(other.get_by_test_id, "run")
    see("run-tick").click()
    expect(other.get_by_test_id("holder-run")).to_contain_text("Another window on this computer has the running tree")
    other.get_by_test_id("run-tick").click()
    expect(other.get_by_test_id("message")).to_contain_text("has the running tree; wait until")
    expect(other.get_by_test_id("run-what")).to_have_text("Tick 1: Pick up YellowBox")
    at_rest(page)
    at_rest(other)
    assert math.dist(position(page, "YellowBox"), position(other, "YellowBox")) < 1e-3
    go(see, "keep")  # lets go
    expect(other.get_by_test_id("holder-run")).to_be_hidden()
    other.get_by_test_id("run-tick").click()
    go(see, "run")
    expect(see("run-what")).to_contain_text("Tick 2")


def test_another_beginning(page, see):
    before = position(page, "YellowBox")
    see("run-layout").click()
    for _ in range(100):
        if math.dist(position(page, "YellowBox"), before) > 0.02:
            break
        page.wait_for_timeout(100)
    at_rest(page)
    play_to_the_end(see)


def test_a_tree_is_corrected_by_hand_with_mouse_and_keyboard(page, see, server):
    see("correct-begin").click()
    expect(see("correct-tools")).to_be_visible()
    node(page, 2).click()
    expect(node(page, 2)).to_have_attribute("aria-pressed", "true")

    see("correct-off").click()
    has(page, 2, "off")
    see("run-play").click()  # follows what runs, beside what is switched off
    expect(see("run-verdict")).to_contain_text("But not all is in place")
    has(page, 1, "success")
    expect(see("correct-tried")).to_contain_text("works in 0 of")
    see("correct-undo").click()
    expect(node(page, 2)).not_to_have_class(re.compile(r"\boff\b"))

    box, goal = (node(page, number).locator(".shape").bounding_box() for number in (2, 1))
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(goal["x"] + goal["width"] / 2, goal["y"] + 10, steps=4)
    page.mouse.move(goal["x"] + 10, goal["y"] + 10, steps=2)
    page.mouse.up()
    expect(node(page, 1)).to_contain_text("GreenBox")
    expect(node(page, 1)).to_be_focused()
    page.keyboard.press("Alt+ArrowRight")
    expect(node(page, 2)).to_contain_text("GreenBox")
    page.keyboard.press("Delete")
    expect(node(page, 2)).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(node(page, 2)).to_contain_text("GreenBox")

    choose_option(page, see("correct-around"), "Try this up to 3 times, until it works", stays=False)
    expect(node(page, 2)).to_contain_text("up to 3 times")
    choose_option(page, see("correct-palette"), "Open the gripper")
    see("correct-before").click()
    expect(node(page, 2)).to_contain_text("Open the gripper")
    see("correct-keep").click()
    expect(see("message")).to_contain_text("The tree is kept as stack-by-hand-")
    (kept,) = (server.folder / "runs").glob("stack-by-hand-*")
    tree = parse_tree((kept / "learnt_tree.txt").read_text())
    assert tree.children[1:] == (parse_tree("open_gripper"), parse_tree(f"retry(3, {TREE.children[1]})"))
    see("correct-begin").click()
    expect(see("correct-tools")).to_be_hidden()
