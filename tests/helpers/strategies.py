"""Hypothesis strategies shared by the tests."""

from collections.abc import Sequence

from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, Control, Kind, Tree, gene_pool
from bt_jax.tasks import load_task

GENES = gene_pool(load_task("stack")).leaves
BOXES = ("YellowBox", "GreenBox", "BlueBox")
_PLACES = ((0.0, 0.0, 0.1), (-0.133, 0.0, 0.055))
ATOMS = (
    *(Behavior("at", (box, place, "KittingBox")) for box in BOXES for place in _PLACES),
    *(Behavior("holding", (box,)) for box in (*BOXES, "nothing")),
    *(Behavior("gripper", (opening,)) for opening in ("open", "closed")),
    *(Behavior("reachable", (box,)) for box in BOXES),
    *(Behavior("clear", (box,)) for box in BOXES),
    Behavior("reached", ("unstacked",)),
    Behavior("open_gripper"),
    Behavior("close_gripper"),
    *(Behavior("pick", (box,)) for box in BOXES),
    *(Behavior("place", (box, place, "KittingBox")) for box in BOXES for place in _PLACES),
)
SUBTASKS = (
    Behavior("subtask", ("one_move", GENES[-1])),
    Behavior(
        "subtask", ("unstack", Control.fallback(Behavior("reached", ("unstacked",)), Control.sequence(*GENES[-3:-1])))
    ),
)


@st.composite
def trees(draw: st.DrawFn, leaves: Sequence[Behavior] = (*ATOMS, *GENES, *SUBTASKS), max_leaves: int = 8) -> Tree:
    """Trees that break none of the rules of `violations`; `leaves` must hold two actions or genes at least."""
    doers = [leaf for leaf in leaves if leaf.kind != Kind.CONDITION]

    def control(kind: Kind, num_leaves: int) -> Control:
        left = draw(st.integers(2, min(5, num_leaves)))
        children: list[Tree] = []
        while left:
            part = num_leaves if left == 1 else draw(st.integers(1, num_leaves - left + 1))
            num_leaves, left = num_leaves - part, left - 1
            if part > 1:
                children.append(control(Kind.FALLBACK if kind == Kind.SEQUENCE else Kind.SEQUENCE, part))
                continue
            before = children[-1] if children else None
            after_doer = isinstance(before, Behavior) and before.kind != Kind.CONDITION
            allowed = doers if after_doer or not left else leaves
            children.append(draw(st.sampled_from([leaf for leaf in allowed if leaf != before])))
        return Control(kind, tuple(children))

    num_leaves = draw(st.integers(1, max_leaves))
    if num_leaves == 1:
        return draw(st.sampled_from(doers))
    return control(draw(st.sampled_from([Kind.SEQUENCE, Kind.FALLBACK])), num_leaves)
