"""How a tree is found: by planning or by evolution; and what the best so far lacks."""

import dataclasses

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes.train_command import ANYWHERE
from bt_jax.app.state import finding
from bt_jax.app.state.finding import commonest, found_by, lacking, plan_first, stalled, starting_at
from bt_jax.app.state.run_record import works
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan_task
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.settings import Settings

STACK = load_task("stack")
HALF = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), open_gripper)")


def test_the_plan_comes_first_and_is_taken_if_it_does():
    search = plan_first(STACK, GPConfig(seed=3))
    assert search.begin.baseline == plan_task(STACK)
    assert (search.gp, search.no_plan) == (GPConfig(seed=3, accept_baseline=True), "")


def test_what_cannot_be_planned_is_evolved_and_the_reason_is_known(monkeypatch):
    def no_plan(task):
        raise UserError("no place is free for BlueBox")

    monkeypatch.setattr(finding, "plan_task", no_plan)
    search = plan_first(STACK, GPConfig(accept_baseline=True))
    assert (search.gp, search.begin, search.no_plan) == (GPConfig(), ANYWHERE, "no place is free for BlueBox")


def test_a_tree_with_genes_under_a_fallback_can_be_where_evolution_starts():
    assert not starting_at(HALF, GPConfig()).gene_under_fallback
    nested = parse_tree("Fallback(is_seen(GreenBox), move(YellowBox, (0, 0, 0.055), KittingBox))")
    assert starting_at(nested, GPConfig()).gene_under_fallback


@pytest.mark.parametrize(
    ("baseline", "accepts", "tree", "words"),
    [
        (None, False, HALF, "Evolved without a plan"),
        (plan_task(STACK), True, plan_task(STACK), "Found by planning"),
        (plan_task(STACK), True, HALF, "Planning alone did not do"),
        (HALF, False, HALF, "Nothing better was found"),
        (HALF, False, plan_task(STACK), "Evolved from the tree that you gave"),
    ],
)
def test_it_says_what_has_found_the_tree(baseline, accepts, tree, words):
    config = RunConfig(STACK, GPConfig(accept_baseline=accepts), Settings(), baseline=baseline)
    assert words in found_by(config, tree)
    assert found_by(dataclasses.replace(config, phase=1), tree) == ""
    assert found_by(None, tree) == found_by(config, None) == ""


def test_it_is_stuck_since_the_last_better_tree():
    assert stalled([]) == 0
    assert stalled([(0, -90.0, -99.0), (4, -80.0, -90.0), (9, -80.0, -85.0), (30, -80.0, -81.0)]) == 26


def test_what_is_lacking_is_said_in_words():
    found = lacking(STACK, Kinematic(STACK), HALF, seed=0)
    assert found.statements == ("GreenBox on top of YellowBox",)
    assert found.reason
    assert lacking(STACK, Kinematic(STACK), plan_task(STACK), seed=0).reason == ""
    restack = load_task("restack")
    assert any("unstacked" in one for one in lacking(restack, Kinematic(restack), HALF, seed=0).statements)


def test_why_a_tested_tree_fails():
    result = {"success_rate": 0.4, "failures": [{"reason": f"{i} fell", "layouts": [1] * (9 - i)} for i in range(5)]}
    assert commonest(result) == ["0 fell (9 times)", "1 fell (8 times)", "2 fell (7 times)"]
    assert commonest({"success_rate": 1.0}) == []


def test_a_tree_works_everywhere_or_mostly_where_things_go_wrong():
    assert works({"success_rate": 1.0})
    assert not works({"success_rate": 0.99})
    assert works({"success_rate": 0.8, "test_draws": 5})
    assert not works({"success_rate": 0.5, "test_draws": 5})
