"""A person who evolves: starts, pauses, resumes, stops, closes the window, and finds everything again."""

import json
import os
import re
import shutil
import signal
import time

import pytest
from playwright.sync_api import expect

from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.training.progress import is_alive, read_progress
from bt_jax.training.run_folder import RunFolder
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.steps import go, until, without_plan

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def evolve(page, see, server):
    """Every test begins at step 2 with nothing evolving."""
    go(see, "evolve")
    expect(see("evolve-sentence")).to_be_visible()
    yield
    if not page.is_closed():
        go(see, "evolve")
        if see("evolve-stop").is_enabled():
            see("evolve-stop").click()
        expect(see("evolve-start")).to_be_enabled()


def start(see, *, population=8, generations=100_000, seed=0):
    without_plan(see)
    see("evolve-population").fill(str(population))
    see("evolve-generations").fill(str(generations))
    see("evolve-seed").fill(str(seed))
    button = see("evolve-start")
    button.click()
    # What the run before has left on the page goes as soon as this one begins.
    button.page.wait_for_function(
        "() => document.querySelector('[data-testid=evolve-start]').disabled", timeout=180_000
    )
    expect(see("evolve-generation")).to_contain_text(" of ")


def generation(see):
    found = re.match(r"(\d+) of", see("evolve-generation").inner_text())
    return int(found[1]) if found else -1


def goes_on(see):
    """Whether another generation appears."""
    now = generation(see)
    end = time.monotonic() + 180
    while generation(see) <= now:
        assert time.monotonic() < end, "no other generation appears"
        time.sleep(0.05)


def newest(server):
    return RunFolder(max((server.folder / "runs").iterdir(), key=lambda path: path.stat().st_mtime_ns))


def test_planning_finds_it_and_evolution_what_planning_does_not(page, see, server):
    """One button; what cannot be planned is evolved, what goes wrong is said, and what is stuck leads on."""
    see("evolve-start").click()
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("evolve-sentence")).to_contain_text("Found by planning")
    expect(see("evolve-sentence")).to_contain_text("works in 100 of 100 starts")
    expect(see("evolve-stage")).to_have_class(re.compile("bg-positive"))
    expect(see("evolve-outcome-said")).to_have_text("It works.")
    see("evolve-watch").click()
    expect(see("panel-run")).to_be_visible()
    go(see, "evolve")

    start(see, generations=1)  # which is not enough
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("evolve-stage")).to_have_class(re.compile("bg-warning"))
    expect(see("evolve-outcome-said")).to_contain_text("work yet:")
    expect(see("evolve-lacking").locator("li").first).to_be_visible()
    see("evolve-show").click()
    expect(see("panel-demonstrate")).to_be_visible()
    go(see, "evolve")


def test_start_pause_resume_stop_and_more(page, see, server):
    start(see)
    expect(see("evolve-stage")).to_have_text("evolving")
    expect(see("evolve-tree").locator("svg")).to_be_visible()
    goes_on(see)
    folder = newest(server)

    press_on(see("evolve-pause"), "Enter")
    expect(see("evolve-stage")).to_have_text("paused")
    expect(see("evolve-pause")).to_contain_text("Resume")
    expect(see("evolve-pause")).to_be_focused()
    held = read_progress(folder.path).generation
    page.reload()
    expect(see("evolve-stage")).to_have_text("paused")
    assert read_progress(folder.path).generation == held

    press_on(see("evolve-pause"), "Enter")
    expect(see("evolve-stage")).to_have_text("evolving")
    goes_on(see)

    see("evolve-stop").click()
    expect(see("evolve-stage")).to_have_text("stopped")
    expect(see("evolve-sentence")).to_contain_text("what was learnt is kept")
    expect(see("evolve-sentence")).to_contain_text("of 100 starts that it has never seen")
    reached = generation(see)
    result = json.loads((folder.path / "result.json").read_text())
    assert (result["generations"], result["last_session"]["stopped"]) == (reached, True)

    see("evolve-more-generations").fill("5")
    see("evolve-more").click()
    expect(see("evolve-generation")).to_have_text(f"{reached + 5} of {reached + 5}")
    expect(see("evolve-stage")).to_have_text("finished")


def test_a_closed_window_stops_nothing_and_another_shows_it_again(window, page, see):
    start(see)
    page.context.close()
    again = window()
    go(again.get_by_test_id, "evolve")
    expect(again.get_by_test_id("evolve-stage")).to_have_text("evolving")
    expect(again.get_by_test_id("evolve-tree").locator("svg")).to_be_visible()
    expect(again.get_by_test_id("evolve-best")).not_to_have_text("\N{EN DASH}")
    goes_on(again.get_by_test_id)
    again.get_by_test_id("evolve-stop").click()
    expect(again.get_by_test_id("evolve-stage")).to_have_text("stopped")


def test_a_reload_in_mid_evolution_loses_nothing(page, see):
    start(see)
    goes_on(see)
    page.reload()
    expect(see("panel-evolve")).to_be_visible()
    expect(see("evolve-stage")).to_have_text("evolving")
    goes_on(see)


def test_two_windows_show_the_same(window, page, see):
    other = window()
    go(other.get_by_test_id, "evolve")
    start(see)
    for seen in (see, other.get_by_test_id):
        goes_on(seen)
    other.get_by_test_id("evolve-pause").click()
    for seen in (see, other.get_by_test_id):
        expect(seen("evolve-stage")).to_have_text("paused")
    for name in ("evolve-generation", "evolve-best", "evolve-mean", "evolve-episodes"):
        expect(see(name)).to_have_text(other.get_by_test_id(name).inner_text())
    until(page, lambda: see("evolve-tree").inner_text() == other.get_by_test_id("evolve-tree").inner_text())
    see("evolve-pause").click()
    expect(other.get_by_test_id("evolve-stage")).to_have_text("evolving")
    see("evolve-stop").click()
    expect(other.get_by_test_id("evolve-stage")).to_have_text("stopped")


def test_the_process_is_killed(page, see, server):
    start(see)
    goes_on(see)
    folder = newest(server)
    end = time.monotonic() + 180
    while folder.load_checkpoint() is None:
        assert time.monotonic() < end
        time.sleep(0.05)
    os.kill(read_progress(folder.path).pid, signal.SIGKILL)
    expect(see("evolve-stage")).to_have_text("killed")
    expect(see("message")).to_contain_text("go on, and it continues from its last checkpoint")
    kept = folder.load_checkpoint().state.generation
    see("evolve-more-generations").fill("100000")
    see("evolve-more").click()
    expect(see("evolve-stage")).to_have_text("evolving")
    goes_on(see)
    assert generation(see) > kept


def test_the_server_is_restarted_while_it_evolves(page, see, server):
    start(see)
    goes_on(see)
    folder = newest(server)
    server.restart(page)
    assert is_alive(folder.path)
    page.goto(f"{server.url}/?step=evolve")
    expect(see("evolve-stage")).to_have_text("evolving")
    goes_on(see)


def test_going_on_asks_for_which_task_when_step_1_says_something_else(page, see, server):
    start(see, generations=3)
    expect(see("evolve-stage")).to_have_text("finished")
    folder = newest(server)
    go(see, "task")
    see("task-remove-GreenBox").click()
    expect(see("task-words-GreenBox")).to_have_text("may be anywhere")
    go(see, "evolve")
    see("evolve-more-generations").fill("1")
    see("evolve-more").click()
    expect(see("goal-differences")).to_contain_text("GreenBox on top of YellowBox")
    see("goal-cancel").click()
    expect(page.locator(".q-dialog")).to_have_count(0)
    for answer, reached, targets in (("own", 4, 2), ("edited", 5, 1)):
        see("evolve-more").click()
        see(f"goal-{answer}").click()
        expect(see("evolve-generation")).to_have_text(f"{reached} of {reached}")
        expect(see("evolve-stage")).to_have_text("finished")
        assert len(folder.config().task.targets) == targets
        go(see, "task")
        expect(see("task-words-GreenBox")).to_have_text("may be anywhere")  # nothing is replaced unasked
        go(see, "evolve")
    see("evolve-more").click()  # both say the same by now
    expect(see("evolve-generation")).to_have_text("6 of 6")
    expect(see("evolve-stage")).to_have_text("finished")
    go(see, "task")
    see("task-revert").click()
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")


def test_a_banner_on_every_step_asks_which_task_counts(page, see, server):
    start(see, generations=3)
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("banner")).not_to_be_visible()
    go(see, "task")
    see("task-remove-GreenBox").click()
    expect(see("banner-text")).to_contain_text(
        "works for: GreenBox on top of YellowBox. Step 1 says: GreenBox may be anywhere."
    )
    for step in ("evolve", "demonstrate", "understand", "combine", "run", "keep", "task"):
        go(see, step)
        expect(see("banner-old"), step).to_be_visible()
    see("banner-both").click()
    expect(see("banner")).not_to_be_visible()
    see("task-undo").click()
    expect(see("message")).to_contain_text("Taken back: now GreenBox on top of YellowBox.")
    see("task-redo").click()  # what was asked about is asked about no more
    expect(see("banner")).not_to_be_visible()
    see("task-add-GreenBox").click()
    expect(see("banner-text")).to_contain_text("Step 1 says: GreenBox on Table")
    see("banner-old").click()
    expect(see("task-words-GreenBox")).to_have_text("on top of YellowBox")
    expect(see("banner")).not_to_be_visible()
    see("task-remove-YellowBox").click()
    see("banner-new").click()
    expect(see("panel-evolve")).to_be_visible()
    expect(see("evolve-generation")).to_have_text("53 of 53")
    expect(see("evolve-stage")).to_have_text("finished")
    assert [target.object for target in newest(server).config().task.targets] == ["GreenBox"]
    expect(see("banner")).not_to_be_visible()
    go(see, "task")
    see("task-revert").click()
    expect(see("task-words-YellowBox")).to_have_text("in the middle of the kit")
    see("banner-both").click()


def test_the_run_folder_vanishes(page, see, server):
    start(see, generations=3)
    expect(see("evolve-stage")).to_have_text("finished")
    folder = newest(server)
    go(see, "keep")
    row = see("keep-runs").get_by_role("row", name=folder.path.name)
    row.get_by_role("checkbox").click()
    expect(see("keep-open")).to_be_enabled()
    shutil.rmtree(folder.path)
    expect(see("message")).to_contain_text("has vanished; choose another run, or start again")
    expect(row).to_have_count(0)
    expect(see("keep-open")).to_be_disabled()
    go(see, "evolve")
    expect(see("evolve-sentence")).to_contain_text("has vanished; choose another run, or start again")
    start(see, generations=3)
    expect(see("evolve-stage")).to_have_text("finished")


def test_another_run_folder_vanishes_while_it_is_listed(page, see, server):
    for seed in (1, 2):
        start(see, generations=3, seed=seed)
        expect(see("evolve-stage")).to_have_text("finished")
        if seed == 1:
            first = newest(server)
    go(see, "keep")
    see("keep-runs").get_by_role("row", name=first.path.name).get_by_role("checkbox").click()
    expect(see("keep-open")).to_be_enabled()
    shutil.rmtree(first.path)
    see("keep-open").click()
    expect(see("message")).to_contain_text("is no longer there; choose another, or evolve again")


def test_settings_that_cannot_work(page, see):
    says = {"population": "population must be a whole number from 8 to", "generations": "generations must be a whole"}
    for field, value, works in (("population", "3", "8"), ("population", "", "8"), ("generations", "0.5", "3")):
        see(f"evolve-{field}").fill(value)
        see(f"evolve-{field}").blur()
        page.wait_for_timeout(200)  # nothing puts another number in its place
        expect(see(f"evolve-{field}"), f"{field} {value}").to_have_value(value)
        see("evolve-start").click()
        expect(see("message"), f"{field} {value}").to_contain_text(says[field])
        expect(see("evolve-start")).to_be_enabled()
        see(f"evolve-{field}").fill(works)
        see("message-close").click()
        expect(see("message")).to_have_text("")


def test_runs_are_compared_opened_downloaded_and_deleted(page, see, server):
    for seed in (1, 2):
        start(see, generations=3, seed=seed)
        expect(see("evolve-stage")).to_have_text("finished")
    go(see, "keep")
    names = sorted((path.name for path in (server.folder / "runs").iterdir()), reverse=True)[:2]
    boxes = [see("keep-runs").get_by_role("row", name=name).get_by_role("checkbox") for name in names]
    for box in boxes:
        box.click()
    for number, name in enumerate(names):
        expect(see(f"keep-name-{number}")).to_contain_text(name)
        expect(see(f"keep-tree-{number}").locator("svg")).to_be_visible()
    expect(see("keep-xml")).to_be_disabled()
    boxes[1].click()
    expect(see("keep-name-1")).not_to_be_visible()
    tree = RunFolder(server.folder / "runs" / names[0]).tree()
    with page.expect_download() as download:
        see("keep-xml").click()
    assert download.value.suggested_filename == f"{names[0]}.xml"
    assert from_xml(download.value.path().read_text(encoding="utf-8")) == tree
    for kind, beginning in (("svg", "<svg"), ("txt", "Sequence" if tree.kind.name == "SEQUENCE" else "")):
        with page.expect_download() as download:
            see(f"keep-{kind}").click()
        assert download.value.path().read_text(encoding="utf-8").startswith(beginning)
    see("keep-open").click()
    expect(see("message")).to_contain_text(f"The run {names[0]} is open")
    see("keep-delete").click()
    see("keep-delete-yes").click()
    expect(see("keep-runs").get_by_role("row", name=names[0])).to_have_count(0)
    assert not (server.folder / "runs" / names[0]).exists()


def test_a_film_is_made_and_downloaded(page, see, server):
    start(see, generations=3)
    expect(see("evolve-stage")).to_have_text("finished")
    folder = newest(server)
    go(see, "keep")
    see("keep-runs").get_by_role("row", name=folder.path.name).get_by_role("checkbox").click()
    with page.expect_download(timeout=600_000) as download:
        see("keep-film").click()
    assert download.value.suggested_filename == f"{folder.path.name}.mp4"
    assert b"ftyp" in download.value.path().read_bytes()[:64]
