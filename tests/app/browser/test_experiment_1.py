"""The paper's experiment 1 through the page: two boxes are stacked by evolution, the third is taught and evolved in."""

import re

import pytest
from playwright.sync_api import expect

from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import DemonstrationFolder
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import UNSEEN
from tests.helpers.browser.gripper import carry
from tests.helpers.browser.keys import press_on
from tests.helpers.browser.steps import go, without_plan

pytestmark = pytest.mark.slow


def fitness(see):
    return float(see("evolve-best").inner_text().replace("\N{MINUS SIGN}", "-").replace(",", ""))


def test_experiment_1_through_the_page(page, see, server, shoot):
    expect(see("task-row-YellowBox")).to_be_visible()
    shoot("task")

    go(see, "evolve")
    without_plan(see)
    see("evolve-start").click()
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("evolve-sentence")).to_contain_text("works in 100 of 100 starts")
    assert fitness(see) > -35
    reached = int(see("evolve-generation").inner_text().split(" of ")[0])
    see("evolve-advanced").get_by_text("Advanced").click()
    shoot("evolve")

    go(see, "demonstrate")
    for number in range(1, 4):
        expect(see("demonstrate-new-reached")).to_be_enabled()
        press_on(see("demonstrate-new-reached"), "Enter")
        expect(see("demonstrate-finish")).to_be_visible()
        page.keyboard.press("3")
        expect(see("demonstrate-done")).to_contain_text("Pick up BlueBox")
        carry(page, see, (0.0, 0.0, 120.0), "GreenBox")
        expect(see("demonstrate-landing")).to_contain_text("BlueBox is set down on GreenBox")
        if number == 3:
            shoot("demonstrate")
        page.keyboard.press("r")
        expect(see("demonstrate-done")).to_contain_text("Put BlueBox on top of GreenBox")
        press_on(see("demonstrate-finish"), "Enter")
        expect(see("demonstrate-progress")).to_contain_text(re.compile(rf"^{number} "))
    taught = DemonstrationFolder(server.folder / "demonstrations" / "demonstrations").read()
    assert [len(one.actions) for one in taught] == [2, 2, 2]

    go(see, "understand")
    expect(see("understand-action-2")).to_contain_text("in 3 of 3 demonstrations")
    # In three stacks all boxes have moved together; the person knows which one is meant.
    see("understand-why-2").get_by_text("Why?").click()
    see("understand-frame-2-GreenBox").click()
    expect(see("understand-action-2")).to_contain_text("BlueBox on top of GreenBox")
    shoot("understand")

    go(see, "combine")
    expect(see("combine-targets")).to_contain_text("BlueBox on top of GreenBox (new)")
    shoot("combine")
    see("combine-go").click()
    expect(see("panel-evolve")).to_be_visible()
    expect(see("evolve-generation")).to_have_text(f"{reached + 50} of {reached + 50}")
    expect(see("evolve-stage")).to_have_text("finished")
    expect(see("evolve-sentence")).to_contain_text("works in 100 of 100 starts")
    assert fitness(see) > -65
    expect(see("evolve-tree")).to_contain_text("BlueBox")

    go(see, "run")
    see("run-tick").click()
    expect(see("run-what")).to_contain_text("Tick 1:")
    see("run-play").click()
    expect(see("run-verdict")).to_contain_text("Everything is where it should be")
    expect(see("run-tree").locator(".success").first).to_be_visible()
    shoot("run")

    go(see, "keep")
    (name,) = [path.name for path in (server.folder / "runs").iterdir()]
    see("keep-runs").get_by_role("row", name=name).get_by_role("checkbox").click()
    expect(see("keep-tree-0").locator("svg")).to_be_visible()
    shoot("keep")
    with page.expect_download() as download:
        see("keep-xml").click()
    tree = from_xml(download.value.path().read_text(encoding="utf-8"))
    folder = RunFolder(server.folder / "runs" / name)
    assert tree == folder.tree()
    task = folder.config().task
    assert {target.object for target in task.targets} == {"YellowBox", "GreenBox", "BlueBox"}
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    settler = Settler(task, MujocoPhysics(task))
    for seed in range(3):
        assert play(semantics, settler, tree, sample_layouts(task, [UNSEEN, seed], 1)).solved
