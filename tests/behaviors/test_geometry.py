"""The scalar reference of geometric conditions, and that simulation and robot mean the same."""

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, Vocabulary
from bt_jax.behaviors.geometry import is_at, is_reachable, rests_on
from bt_jax.encoding.status import Status
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
AT = Behavior("at", ("YellowBox", (0.0, 0.0, 0.03), "KittingBox"))
ASKED = (
    AT,
    *(Behavior(name, (box,)) for name in ("clear", "reachable") for box in TASK.object_names),
)
SEMANTICS = LeafSemantics(TASK, Vocabulary.of(ASKED))
SIZES = [box.edge for box in TASK.objects]
LOWEST = min(table.top for table in TASK.tables)
# Millimetres, and a part of one, so that no difference of two comes near to a limit: the simulation computes in 32 bits.
NEAR = st.integers(-70, 70).map(lambda millimetres: millimetres / 1000)
SHARES = (0.00011, 0.00043, 0.00067)


@st.composite
def positions(draw: st.DrawFn) -> np.ndarray:
    """Boxes [B, 3] in the world, all near each other and near the lowest table's top."""
    return np.array([[draw(NEAR) + share, draw(NEAR) + share, LOWEST + draw(NEAR) + share] for share in SHARES])


@settings(max_examples=300, deadline=None)
@given(boxes=positions(), kit=st.tuples(NEAR, NEAR), held=st.integers(-1, len(SIZES) - 1))
def test_the_simulation_means_the_same_for_random_states(boxes, kit, held):
    origin = np.array([*kit, LOWEST])
    assume(abs(math.dist(boxes[0], origin + AT.position) - TASK.episode.tolerance) > 1e-5)
    upright = np.tile([1.0, 0, 0, 0], (len(SIZES), 1))
    world = World(
        kits=origin[None, None].astype(np.float32),
        poses=np.concatenate([boxes, upright], axis=1)[None].astype(np.float32),
        held=np.array([held], np.int8),
        gripper_open=np.array([held < 0]),
        reached=np.zeros((1, len(TASK.subgoals)), bool),
    )
    outcomes = SEMANTICS.outcomes(world)[0, 0]
    found = {leaf: int(outcomes[SEMANTICS.vocabulary.token(leaf)]) == Status.SUCCESS for leaf in ASKED}
    assert found[AT] == (held != 0 and is_at(boxes[0], origin + AT.position, TASK.episode.tolerance))
    for i, box in enumerate(TASK.object_names):
        covers = [
            rests_on(boxes[j], boxes[i], SIZES[j], SIZES[i]) for j in range(len(SIZES)) if i != j and held not in (i, j)
        ]
        assert found[Behavior("clear", (box,))] == (not any(covers))
        assert found[Behavior("reachable", (box,))] == is_reachable(float(boxes[i, 2]), LOWEST, SIZES[i])


def test_what_lies_on_top_rests_on_it_and_what_lies_beside_does_not():
    origin = (0.0, 0.0, 0.0)
    assert rests_on((0.0, 0.0, 0.04), origin, 0.04, 0.04)
    assert rests_on((0.03, -0.03, 0.04), origin, 0.04, 0.04)
    assert not rests_on((0.041, 0.0, 0.04), origin, 0.04, 0.04)
    assert not rests_on(origin, (0.0, 0.0, 0.04), 0.04, 0.04), "the lower one does not rest on the upper one"
    assert not rests_on((0.0, 0.0, 0.08), origin, 0.04, 0.04), "there is room for one between them"
    assert not is_reachable(0.02, 0.75, 0.04)
    assert is_reachable(0.77, 0.75, 0.04)
