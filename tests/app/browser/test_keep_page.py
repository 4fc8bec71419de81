"""Runs are named, compared, reported and watched where they fail; trees and kits come and go; what is deleted comes back."""

import pytest
from playwright.sync_api import expect

from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import RunNote, read_note
from bt_jax.training.settings import Settings
from tests.helpers.browser.axe import axe_script, grave_faults
from tests.helpers.browser.steps import go
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

pytestmark = pytest.mark.slow

STACK = load_task("stack")
TREE = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
FAILURES = [{"reason": "BlueBox is in the way", "layouts": [2, 3], "draws": []}]
AXE = axe_script()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three runs, of which one fails in two starts of its test, and a set of demonstrations."""
    folder = tmp_path_factory.mktemp("page")
    for seed, name in enumerate(("first", "second", "third")):
        run = RunFolder.create(folder / "runs" / name, RunConfig(STACK, GPConfig(seed=seed), Settings(test_layouts=5)))
        run.save_tree(TREE, title=name)
        run.save_result({"test_layouts": 5, "success_rate": 0.6 if seed == 0 else 1.0, "failures": FAILURES[seed:]})
    kept = DemonstrationFolder(folder / "demonstrations" / "shown")
    kept.create(Frames.of(STACK3))
    for one in demonstrations(STACK3, STACKING):
        kept.append(one)
    return folder


def part(see, name):
    """Shows a part of the step."""
    go(see, "keep")
    see("keep-part").get_by_role("button", name=name).click()


def tick(see, name):
    see("keep-runs").get_by_role("row", name=name).get_by_role("checkbox").click()


def check_accessible(page):
    if AXE is not None:
        page.emulate_media(reduced_motion="reduce")
        assert grave_faults(page, AXE) == []


def test_a_run_is_named_reported_and_watched_where_it_fails(page, see, folder):
    part(see, "Runs")
    tick(see, "first")
    see("keep-name").fill("the one for Monday")
    see("keep-note").fill("BlueBox must not stand in the kit")
    see("keep-note-save").click()
    expect(see("keep-runs").get_by_role("row", name="the one for Monday (first)")).to_contain_text("3 of 5")
    assert read_note(folder / "runs" / "first") == RunNote("the one for Monday", "BlueBox must not stand in the kit")
    check_accessible(page)
    with page.context.expect_page() as opened:
        see("keep-report").click()
    report = opened.value
    expect(report.get_by_role("heading", name="the one for Monday")).to_be_visible()
    expect(report.get_by_text("BlueBox is in the way")).to_be_visible()
    expect(report.get_by_role("button", name="Print")).to_be_visible()
    report.emulate_media(media="print")
    expect(report.get_by_role("button", name="Print")).not_to_be_visible()
    report.close()
    see("keep-replay-3").click()
    expect(see("panel-run")).to_be_visible()
    expect(see("run-source")).to_have_value("first")
    expect(see("message")).to_contain_text("This is start 3 of the test of the one for Monday.")
    expect(see("run-what")).to_contain_text("Tick ")


def test_any_number_of_runs_is_compared_and_deleted_runs_come_back(page, see, folder):
    part(see, "Runs")
    page.reload()
    part(see, "Runs")
    for name in ("first", "second", "third"):
        tick(see, name)
    expect(see("keep-differences").get_by_role("row", name="seed")).to_contain_text("012")
    for number in range(3):
        expect(see(f"keep-tree-{number}").locator("svg")).to_be_visible()
    check_accessible(page)
    tick(see, "first")
    see("keep-delete").click()
    see("keep-delete-yes").click()
    expect(see("keep-runs").get_by_role("row", name="third")).to_have_count(0)
    assert [path.name for path in (folder / "runs").iterdir()] == ["first"]
    part(see, "Trash")
    check_accessible(page)
    see("trash-restore-third").click()
    expect(see("message")).to_have_text("The run third is back.")
    assert (folder / "runs" / "third" / "best_tree.txt").is_file()
    see("trash-empty").click()
    see("trash-empty-yes").click()
    expect(see("trash-hint")).to_have_text("The trash is empty.")
    assert not (folder / "trash").exists()


def test_trees_and_kits_come_and_go(page, see, folder, tmp_path):
    def choose(testid, file):
        with page.expect_file_chooser() as chooser:
            see(testid).click()
        chooser.value.set_files(file)

    part(see, "Tasks, demonstrations, trees")
    (tmp_path / "other.txt").write_text("pick(PinkBox)")
    choose("tree-import", tmp_path / "other.txt")
    expect(see("message")).to_contain_text("other.txt: ")
    expect(see("message")).to_contain_text("PinkBox")
    (tmp_path / "mine.txt").write_text(str(TREE))
    choose("tree-import", tmp_path / "mine.txt")
    expect(see("things-tree-mine")).to_contain_text("for the task stack")
    with page.expect_download() as download:
        see("things-xml-mine").click()
    assert from_xml(download.value.path().read_text(encoding="utf-8")) == TREE
    check_accessible(page)
    see("kit-save").click()
    see("kit-sets").click()
    page.get_by_role("option", name="shown").click()
    page.keyboard.press("Escape")
    see("kit-trees").click()
    page.get_by_role("option", name="mine").click()
    page.keyboard.press("Escape")
    with page.expect_download() as download:
        see("kit-save-yes").click()
    assert download.value.suggested_filename == "stack.kit.zip"
    kit = tmp_path / "stack.kit.zip"
    download.value.save_as(kit)
    see("things-delete-mine").click()
    see("things-delete-yes").click()
    expect(see("things-tree-mine")).to_have_count(0)
    choose("kit-open", kit)
    expect(see("things-demonstrations-shown-2")).to_contain_text("3 demonstrations")
    expect(see("things-tree-mine")).to_be_visible()
    kit.write_bytes(kit.read_bytes()[:300])
    choose("kit-open", kit)
    expect(see("message")).to_contain_text("stack.kit.zip cannot be opened: it is no zip file")
    go(see, "run")
    see("run-source").click()
    page.get_by_role("option", name="tree: mine").click()
    expect(see("run-tree")).to_contain_text("Put GreenBox on")
