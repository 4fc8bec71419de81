import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import FIRST_LEAF, Behavior, Control, Kind, Vocabulary, check_names, gene_pool, parse_behavior
from bt_jax.tasks import load_task, task_names
from tests.helpers.strategies import ATOMS, GENES

numbers = st.floats(-10, 10, allow_nan=False).map(lambda x: x + 0.0)
positions = st.tuples(numbers, numbers, numbers)


@given(st.sampled_from((*ATOMS, *GENES)))
def test_text_is_read_back(behavior):
    assert parse_behavior(str(behavior)) == behavior


@given(positions)
def test_positions_are_read_back_exactly(position):
    behavior = Behavior("place", ("A", position, "B"))
    assert parse_behavior(str(behavior)) == behavior


@pytest.mark.parametrize(
    "text",
    [
        "",
        "fly(Box)",
        "pick",
        "pick(A, B)",
        "pick((0, 0, 1))",
        "at(A, (0, 0), B)",
        "at(A, (0, 0, x), B)",
        "at(A, (0, 0, nan), B)",
        "at(A, B, (0, 0, 0))",
        "gripper(ajar)",
        "pick(A) place",
        "pick(A) extra",
        "pick(YellowBox,,)",
        "pick(YellowBox,)",
        "at(Box (0,0,0.1) Frame)",
        "at(Box (0, 0, 0.1), Frame)",
        "at(A, (0, 0, 0, 0), B)",
    ],
)
def test_what_is_no_behavior_is_refused(text):
    with pytest.raises(UserError):
        parse_behavior(text)


@pytest.mark.parametrize("position", [(0.0, 0.0), (0.0, 0.0, np.nan), (0.0, 0.0, "x"), ()])
def test_a_position_has_three_finite_numbers(position):
    with pytest.raises(UserError, match="three numbers in metres"):
        Behavior("place", ("A", position, "B"))


def test_the_gene_of_the_paper():
    gene = Behavior("move", ("A", (0.0, 0.0, 0.1), "B"))
    opened = Control.fallback(Behavior("gripper", ("open",)), Behavior("open_gripper"))
    picked = Control.fallback(Behavior("holding", ("A",)), Control.sequence(opened, Behavior("pick", ("A",))))
    at, place = (Behavior(name, gene.args) for name in ("at", "place"))
    assert gene.subtree == Control.fallback(at, Control.sequence(picked, place))


def test_the_published_pool():
    pool = gene_pool(load_task("stack"))
    genes = [leaf for leaf in pool.leaves if leaf.kind == Kind.GENE]
    assert len(genes) == 57
    assert len(pool.leaves) == 57 + 5
    on_box = [gene for gene in genes if gene.frame == "YellowBox" and gene.object == "GreenBox"]
    assert {gene.position for gene in on_box} == {
        (-0.12, 0.0, 0.0),
        (0.12, 0.0, 0.0),
        (0.0, -0.12, 0.0),
        (0.0, 0.12, 0.0),
        (0.0, 0.0, 0.1),
    }
    in_kit = {gene.position for gene in genes if gene.frame == "KittingBox" and gene.object == "BlueBox"}
    assert in_kit == {(x, y, 0.055) for x in (-0.133, 0.0, 0.133) for y in (-0.133, 0.0, 0.133)}
    assert Behavior("reached", ("unstacked",)) in gene_pool(load_task("restack")).leaves


def test_what_no_slot_takes_goes_on_the_grid(tmp_path):
    written = """
extends: kitting
name: tray
description: A plate in the middle of a tray whose slots are for bolts.
objects:
  - {name: Plate, size: [0.2, 0.1, 0.02], color: [1, 0, 0]}
  - {part: Bolt, count: 2, radius: 0.012, height: 0.06, color: [0, 0, 1]}
kits:
  - name: Tray
    table: TableLeft
    slots: [{name: low, position: [-0.15, 0.15], for: Bolt}, {name: high, position: [0.15, 0.15], for: Bolt}]
targets:
  - {object: Plate, position: [0, 0, 0.0125], frame: Tray, turn: 90}
  - {object: Bolt, slot: Tray.low}
"""
    path = tmp_path / "tray.yaml"
    path.write_text(written)
    leaves = gene_pool(load_task(path)).leaves
    assert Behavior("move", ("Plate", (0.0, 0.0, 0.0125), "Tray", 90.0)) in leaves
    bolts = {leaf.position[:2] for leaf in leaves if leaf.object == "Bolt" and leaf.frame == "Tray"}
    assert bolts == {(-0.15, 0.15), (0.15, 0.15)}


def heights_on_the_grid(text, path):
    path.write_text(text)
    task = load_task(path)
    leaves = [leaf for leaf in gene_pool(task).leaves if leaf.kind == Kind.GENE and leaf.frame in task.kit_names]
    return {leaf.object: leaf.position[2] for leaf in leaves}


MIXED = """
name: mine
kits: [{name: Tray, size: 0.4}]
objects:
  - {name: Plate, size: [0.1, 0.08, 0.02], color: [1, 0, 0]}
  - {name: Cube, size: 0.08, color: [1, 0, 0]}
targets: [{object: Cube, position: [0, 0, 0.0425], frame: Tray}]
"""


def test_objects_on_the_grid_stand_on_the_plate_or_at_the_height_that_is_given(tmp_path):
    path = tmp_path / "mine.yaml"
    on_plate = {"Plate": 0.0125, "Cube": 0.0425}
    assert heights_on_the_grid(f"extends: kitting{MIXED}", path) == on_plate
    assert heights_on_the_grid(f"extends: stack{MIXED}", path) == on_plate
    assert heights_on_the_grid(f"extends: stack{MIXED}genes: {{height: 0.06}}", path) == {"Plate": 0.06, "Cube": 0.06}
    only_cubes = MIXED.replace("[0.1, 0.08, 0.02]", "0.04")
    assert heights_on_the_grid(f"extends: kitting{only_cubes}", path) == {"Plate": 0.0225, "Cube": 0.0425}
    changed = "extends: stack\nname: mine\ndescription: The boxes of stack."
    assert set(heights_on_the_grid(changed, path).values()) == {0.055}


def genes_that_meet(task, i):
    """Genes whose object, place and turn are those of a target."""
    target, pool = task.targets[i], gene_pool(task).leaves
    symmetry = task.thing(target.object).symmetry

    def meets(gene):
        near = gene.frame == target.frame and gene.object == target.object
        turned = target.turn is None or (gene.turn is not None and (gene.turn - target.turn) % symmetry == 0)
        return near and turned and np.allclose(gene.position, target.position, atol=0.005)

    return [gene for gene in pool if gene.kind == Kind.GENE and meets(gene)]


INSTANCES = """
extends: kitting
name: lid
objects:
  - {part: Bolt, count: 3, radius: 0.02, height: 0.06, color: [0.6, 0.6, 0.6]}
  - {name: Lid, size: [0.04, 0.03, 0.02], color: [1, 0, 0]}
kits:
  - {name: Tray, size: [0.3, 0.12], wall_height: 0.02, grid: [1, 3]}
targets:
  - {object: Bolt2, slot: Tray.r1c1}
  - {object: Bolt, slot: Tray.r1c2}
  - {object: Lid, position: [0, 0, 0.04], frame: Bolt2, turn: 0}
subgoals:
  - {name: freed, conditions: ["clear(Bolt3)", "reachable({box})"]}
"""


def test_instances_that_a_target_or_a_subgoal_names_have_genes(tmp_path):
    path = tmp_path / "lid.yaml"
    path.write_text(INSTANCES)
    task = load_task(path)
    assert all(genes_that_meet(task, i) for i in range(3))
    genes = [leaf for leaf in gene_pool(task).leaves if leaf.kind == Kind.GENE]
    assert {gene.object for gene in genes} == {"Bolt", "Bolt2", "Bolt3", "Lid"}
    assert {gene.frame for gene in genes} == {"Bolt2", "Bolt3", "Lid", "Tray"}


CUBES = """
extends: kitting
name: cubes
objects:
  - {name: A, size: 0.08, color: [0.6, 0.6, 0.6]}
  - {name: B, size: 0.08, color: [0.6, 0.6, 0.6]}
  - {name: C, size: 0.03, color: [0.6, 0.6, 0.6]}
kits:
  - {name: Tight, size: [0.3, 0.2], wall_height: 0.03, grid: [2, 3], dividers: true}
targets:
  - {object: A, slot: Tight.r1c1}
  - {object: B, position: [0, 0.0475, 0.0425], frame: Tight, turn: 90}
  - {object: C, slot: Tight.r1c3}
"""


def test_cubes_are_turned_where_a_target_says_how(tmp_path):
    path = tmp_path / "cubes.yaml"
    path.write_text(CUBES)
    task = load_task(path)
    assert [target.turn for target in task.targets] == [0.0, 90.0, None]
    assert all(genes_that_meet(task, i) for i in range(3))
    assert {(leaf.object, leaf.turn) for leaf in gene_pool(task).leaves if leaf.kind == Kind.GENE} == {
        ("A", 0.0),
        ("B", 0.0),
        ("C", None),
    }


@pytest.mark.parametrize("name", task_names())
def test_every_pool_fits_its_task(name):
    task = load_task(name)
    for leaf in gene_pool(task).leaves:
        check_names(leaf, task)


def test_tokens_stand_for_leaves():
    vocabulary = Vocabulary.of((*GENES, *ATOMS, *GENES))
    assert len(vocabulary.leaves) == len({*GENES, *ATOMS})
    for i, leaf in enumerate(vocabulary.leaves):
        assert vocabulary.token(leaf) == FIRST_LEAF + i
        assert vocabulary.leaf(FIRST_LEAF + i) == leaf
        assert vocabulary.kinds[FIRST_LEAF + i] == leaf.kind
    extra = Behavior("pick", ("RedBox",))
    assert set(vocabulary.extended([extra]).leaves) == {*vocabulary.leaves, extra}


@pytest.mark.parametrize(
    ("leaf", "remedy"),
    [
        (Behavior("pick", ("RedBox",)), "use one of YellowBox"),
        (Behavior("at", ("GreenBox", (0.0, 0.0, 0.1), "RedBox")), "use one of YellowBox"),
        (Behavior("at", ("GreenBox", (0.0, 0.0, 0.1), "GreenBox")), "use one of YellowBox"),
        (Behavior("reached", ("tidy",)), "add it under subgoals"),
        (Behavior("subtask", ("rest", Behavior("pick", ("RedBox",)))), "use one of YellowBox"),
        (Behavior("pick", ("nothing",)), "use one of YellowBox"),
    ],
)
def test_names_that_a_task_does_not_have(leaf, remedy):
    with pytest.raises(UserError, match=remedy):
        check_names(leaf, load_task("stack"))
