"""Plans for a world in which things go wrong are patient: they look, and they try again."""

import pytest

from bt_jax.behaviors import ExtendedNode, Vocabulary, expand
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import plan_task
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.faults.fates import sample_episodes
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import load_faults, load_task, with_faults


@pytest.mark.parametrize("name", ["stack3", "kit6", "restack", "mobile_stack"])
def test_everything_that_is_placed_is_looked_for_and_retried(name):
    task = load_task(name)
    tree = plan_task(with_faults(task, load_faults("harsh")))
    assert violations(tree) == []
    assert [leaf for leaf in leaves(tree) if leaf.name != "look"] == leaves(plan_task(task))
    for part in tree.children:
        assert isinstance(part, ExtendedNode)
        found = leaves(expand(part))
        placed = {leaf.object for leaf in found if leaf.name == "place"}
        assert placed <= {leaf.object for leaf in found if leaf.name == "look"}


def test_a_patient_plan_solves_more_where_things_go_wrong():
    plain = load_task("stack3")
    task = with_faults(plain, load_faults("harsh"))
    layouts, fates = sample_episodes(task, 0, layouts=20, draws=2)
    solved = []
    for tree in (plan_task(plain), plan_task(task)):
        semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
        solved.append(int(survey(semantics, Kinematic(task), tree, layouts, fates).solved.sum()))
    assert solved[1] >= solved[0] + 10
