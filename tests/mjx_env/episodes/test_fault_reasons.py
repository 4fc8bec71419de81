import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.faults.events import hides, moves, takes
from bt_jax.mjx_env.faults.fates import nothing_wrong
from bt_jax.mjx_env.faults.variants import NUM_ERRORS
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.choreography import shots
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Faults, load_task, with_faults

TASK = with_faults(load_task("stack"), Faults(slip=0.1, place_spread=0.01))
FIRST, SECOND = "(0, 0, 0.055), KittingBox", "(0, 0, 0.1), YellowBox"
SOLUTION = f"Sequence(move(YellowBox, {FIRST}), move(GreenBox, {SECOND}))"
ONCE = "Fallback(holding(YellowBox), Sequence(reachable(YellowBox), pick(YellowBox)))"
YELLOW, PLACE = 0, 2 + len(TASK.kinds)  # index of the object, and of the class of its places


def played(text, fate):
    tree = parse_tree(text)
    semantics = LeafSemantics(TASK, Vocabulary.of(leaves(tree)))
    return semantics, play(semantics, Settler(TASK, Kinematic(TASK)), tree, sample_layouts(TASK, 0, 1), fate)


def dropped(fate):
    fate.variant[0, :, PLACE] = NUM_ERRORS + 2


def jammed(fate):
    fate.variant[0, :, PLACE] = NUM_ERRORS + 1


def strayed(fate):
    units = np.full((1, TASK.episode.max_ticks, len(TASK.kinds), 3), 4.0, np.float32)
    fate.variant[0, :, PLACE] = 1
    return dataclasses.replace(fate, unit=units)


def hidden(fate):
    fate.sight[0, 1] = hides(YELLOW)


def taken(fate):
    fate.person[0, 0] = takes(TASK, 1)


def moved(fate):
    fate.person[0, 3] = moves(TASK, 1, 0)


PUT = f"Fallback(Sequence({ONCE}, place(YellowBox, {FIRST})), close_gripper, gripper(closed))"


@pytest.mark.parametrize(
    ("happens", "text", "reason"),
    [
        (hidden, SOLUTION, "the tree fails while YellowBox is out of sight"),
        (taken, SOLUTION, "the tree fails while a person has GreenBox"),
        (dropped, PUT, "YellowBox drops on the way and is not put there again"),
        (strayed, PUT, "YellowBox is put down too far off and stays there"),
        (jammed, PUT, "the gripper does not let go of YellowBox, and that is not tried again"),
    ],
)
def test_the_reason_is_the_fault_that_the_tree_does_not_get_over(happens, text, reason):
    fate = nothing_wrong(TASK, 1)
    semantics, found = played(text, happens(fate) or fate)
    assert not found.solved
    assert explain_failure(TASK, found) == reason
    assert shots(semantics, found, fps=5.0)


def test_a_tree_that_looks_after_its_targets_puts_back_what_a_person_moves():
    fate = nothing_wrong(TASK, 1)
    moved(fate)
    semantics, found = played(SOLUTION, fate)
    assert any("a person moves GreenBox" in tick.troubles for tick in found.ticks)
    assert found.solved
    last = shots(semantics, found, fps=5.0)[-1]
    np.testing.assert_allclose(last.poses, found.final.poses[0], atol=1e-6)
