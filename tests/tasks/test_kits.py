"""Tasks with kits, slots, parts and shapes that are invalid, and those that are as tight as may be."""

import contextlib
import copy
import dataclasses
import itertools

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Vocabulary
from bt_jax.encoding import leaves, parse_tree
from bt_jax.mjx_env import Kinematic, LeafSemantics, Settler, play, sample_layouts
from bt_jax.tasks import load_task, task_from_dict
from bt_jax.tasks.checks import check
from bt_jax.tasks.footprints import Footprint, overlap
from bt_jax.tasks.slots import fits, slot_turn
from bt_jax.tasks.things import Kit, Object, Slot

RED = [1, 0, 0]
PLATE = {"name": "Plate", "size": [0.16, 0.08, 0.02], "color": RED}
CAN = {"name": "Can", "radius": 0.03, "height": 0.1, "color": RED}
BOLTS = {"part": "Bolt", "count": 2, "radius": 0.02, "height": 0.06, "color": RED}
TRAY = {"name": "Tray", "size": [0.4, 0.3], "slots": [{"name": "a", "position": [-0.1, 0], "turn": 90, "for": "Plate"}]}
IN_SLOT = {"object": "Plate", "slot": "Tray.a"}
AT = {"object": "Can", "position": [0.1, 0, 0.0525], "frame": "Tray"}
BOLT_AT = {"object": "Bolt", "position": [0.1, 0.1, 0.0325], "frame": "Tray"}
SMALL_TABLES = [{"name": name, "position": [x, 0, 0.3], "size": [0.5, 0.5, 0.6]} for name, x in (("L", -1), ("R", 1))]
KIT = {
    "extends": "kitting",
    "name": "mine",
    "objects": [PLATE, CAN, BOLTS],
    "kits": [TRAY],
    "targets": [IN_SLOT, AT, BOLT_AT],
}


def slots(*given, **tray):
    return {
        "kits": [TRAY | {"slots": [{"name": f"s{i}"} | slot for i, slot in enumerate(given)]} | tray],
        "targets": [AT],
    }


def trays(**second):
    return {"kits": [TRAY, {"name": "Other", "size": 0.2} | second]}


def objects(*more, first=PLATE):
    return {"objects": [first, CAN, BOLTS, *more]}


def targets(*given):
    return {"targets": list(given)}


def fixed(name, position, turn=None):
    place = {"object": name, "position": position, "frame": "base_link", "turn": turn}
    return {"layout": {"kit": "TableLeft", "fixed": [place]}}


def bolts(count):
    return {"objects": [PLATE, CAN, BOLTS | {"count": count}]}


CASES = [
    (slots({"position": [0, 0], "for": "Plate"}, {"position": [0.05, 0], "for": "Can"}), "kits[0].slots[1].position",
     "the slots s0 and s1 of Tray overlap; move it away from slots[0]"),
    (slots({"position": [0, 0]}, {"position": [0, 0]}), "kits[0].slots[1].position", "overlap"),
    (slots({"position": [0, 0]}, {"position": [0.03, 0]}), "kits[0].slots[1].position", "overlap"),
    (slots({"position": [0.25, 0]}), "kits[0].slots[0].position", "the slot is outside Tray; write x and y from -0.195 to"),
    (slots({"position": [0, 0], "for": "Cup"}), "kits[0].slots[0].for", "there is no object 'Cup'; use one of Plate, Can"),
    (slots({"position": [0, 0], "takes": "Cup"}), "kits[0].slots[0].for", "there is no object 'Cup'"),
    (slots({"position": [0, 0], "for": 5}), "kits[0].slots[0].for", "expected text, found 5; put it in quotes: '5'"),
    (slots({"position": [0, 0], "fro": "Can"}), "kits[0].slots[0].fro", "not known here; did you mean for?"),
    (slots({"position": [0, 0], "object": "Can"}), "kits[0].slots[0].object", "use one of name, position, turn, for"),
    (slots({"position": [0.15, 0], "for": "Plate"}), "kits[0].slots[0].position",
     "Plate (160 x 80 x 20 mm) does not fit in 90 x 290 mm between the walls"),
    (slots({"name": "a b", "position": [0, 0]}), "kits[0].slots[0].name", "is not a name"),
    (slots({"position": [0, 0]}, {"name": "s0", "position": [0.1, 0]}), "kits[0].slots[0].name",
     "two slots of Tray are called 's0'"),
    (slots({"name": "r1c1", "position": [0, 0]}, grid=[1, 1]), "kits[0].slots[0].name", "are called 'r1c1'"),
    (slots(dividers=True), "kits[0].dividers", "there is no grid to divide; add a grid"),
    (slots(grid=[20, 2], size=[0.4, 0.08], dividers=True), "kits[0].grid", "the dividers leave no room"),
    (targets(IN_SLOT | {"object": "Can"}), "targets[0].slot", "Tray.a is for Plate, not for Can"),
    ({"kits": [TRAY | {"grid": [4, 8]}], "targets": [{"object": "Plate", "slot": "Tray.r1c1"}]}, "targets[0].slot",
     "Plate (160 x 80 x 20 mm) does not fit in Tray.r1c1, 48.75 x 72.5 mm between the walls"),
    (targets({"object": "Bolt", "slot": "Tray.b"}), "targets[0].slot", "there is no slot 'Tray.b'; use one of Tray.a"),
    (targets(AT | {"frame": "base_link", "position": [0.0, 0.2, 0.0]}), "targets[0].position", "Can would be below the"),
    (targets(AT | {"frame": "base_link", "position": [0.0, -1.0, 0.4]}), "targets[0].position", "Can would be below the"),
    (targets(AT | {"position": [0.6, 0.0, -0.7]}), "targets[0].position", "Can would be below the tables, out of the"),
    (targets(AT | {"turn": 90}), "targets[0].turn", "Can is a cylinder, which looks alike in every turn; leave turn out"),
    (targets(BOLT_AT | {"turn": 90}), "targets[0].turn", "Bolt is a cylinder"),
    ({"layout": {"kit": "TableLeft", "fixed": [AT | {"position": [0, -1, 0.75], "frame": "base_link", "turn": 5}]}},
     "layout.fixed[0].turn", "Can is a cylinder"),
    (fixed("Plate", [-1.2, -1.0, 0.7125]), "layout.fixed[0].position", "Plate would be inside Tray; move it to free space"),
    (fixed("Plate", [-1.0, -1.0, 0.7]), "layout.fixed[0].position", "Plate would be inside Tray; move it to free space"),
    (fixed("Plate", [-1.13, -1.0, 0.715], 45), "layout.fixed[0].position", "Plate would be inside Tray"),
    (objects(CAN), "objects[3].name", "two of them are called 'Can'; rename one of them"),
    (objects(BOLTS), "objects[3].part", "two of them are called 'Bolt1'"),
    (objects(CAN | {"name": "Bolt1"}), "objects[3].name", "'Bolt1' is also an instance of the part Bolt"),
    (objects(CAN | {"name": "Bolt"}), "objects[3].name", "'Bolt' is also a part"),
    (objects(CAN | {"name": "Tray"}), "objects[3].name", "'Tray' is also a kit"),
    (objects(CAN | {"name": "TableLeft"}), "objects[3].name", "'TableLeft' is also a table"),
    (objects({**BOLTS, "part": "Tray"}), "objects[3].part", "'Tray' is also a kit"),
    (objects({**BOLTS, "part": "base_link"}), "objects[3].part", "'base_link' is also the robot's frame"),
    (objects({"name": "Big", "part": "Bolt", "size": 0.05, "color": RED}), "objects[3].size", "Big is unlike Bolt1"),
    ({"kits": [TRAY, TRAY]}, "kits[1].name", "two of them are called 'Tray'"),
    ({"kits": [TRAY | {"size": 1.0}]}, "kits[0].size", "1 m is wider than TableLeft"),
    ({"kits": [TRAY | {"position": [0.3, 0]}]}, "kits[0].position", "Tray would reach beyond the edge of TableLeft"),
    (trays(), "kits[1].position", "Other would overlap Tray on TableLeft; move one of them, or name another table"),
    (trays(table="TableMiddle", position=[0, 0.2]), "kits[1].position", "Other would overlap Tray on TableMiddle"),
    (trays(table="Shelf"), "kits[1].table", "there is no table 'Shelf'; use one of TableLeft"),
    ({"kits": [TRAY | {"table": "TableLeft"}, {"name": "B", "size": 0.2, "table": "TableRight"},
               {"name": "C", "size": 0.2, "table": "TableMiddle"}]}, "tables", "the kits may take every table"),
    ({"kits": [{"name": f"K{i}", "size": 0.1} for i in range(4)] + [TRAY]}, "kits", "5 kits are too many; use 4 or fewer"),
    (bolts(15), "objects", "17 objects are too many; use 16 or fewer"),
    (bolts(0), "objects[2].count", "0 is too few"),
    (bolts(14) | {"tables": SMALL_TABLES}, "objects",
     "16 objects, 0.12 m apart and with room for the fingers, do not fit on the tables"),
    (targets(*[BOLT_AT] * 3), "targets[2].object", 
     "there are only 2 of Bolt; raise its count or drop a target"),
    (targets(BOLT_AT, BOLT_AT | {"object": "Bolt1", "position": [0, 0, 0.0325]}) | bolts(1), "targets[1].object",
     "there is only 1 of Bolt"),
    (targets(BOLT_AT | {"object": "Bolt2"}, BOLT_AT | {"position": [0, 0, 0.0325]}, BOLT_AT), "targets[2].object",
     "there are only 2 of Bolt"),
    (targets(AT, AT), "targets[1].object", "Can has a target already"),
    (targets({"object": "Can", "position": [0, 0, 0.08], "frame": "Bolt"}), "targets[0].frame",
     "'Bolt' is a part, and a frame is one object; use one of Bolt1, Bolt2"),
    (targets(IN_SLOT, AT | {"position": [-0.1, 0.07, 0.0525]}), "targets[1]", "Can would be inside Plate of targets[0]"),
    (targets(BOLT_AT, BOLT_AT), "targets[1]", "Bolt would be inside Bolt of targets[0]"),
    (targets(IN_SLOT, AT) | {"episode": {"max_ticks": 5}}, "episode.max_ticks",
     "5 ticks are too few to move 2 objects; write 6 or more"),
    (objects(first=PLATE | {"size": [0.2, 0.13, 0.02]}), "objects[0].size",
     "0.13 m does not fit the gripper, which opens 0.12 m"),
    ({"objects": [PLATE, CAN | {"radius": 0.07}, BOLTS]}, "objects[1].radius",
     "a radius of 0.07 m makes it 0.14 m wide and does not fit the gripper, which opens 0.12 m"),
    ({"objects": [PLATE, CAN | {"radius": 30}, BOLTS]}, "objects[1].radius",
     "30 is implausible; write 0.0025 to 1 m (metres? 30 mm are 0.03 m)"),
    ({"objects": [PLATE, CAN | {"height": 100}, BOLTS]}, "objects[1].height", "100 is implausible; write 0.005 to 2 m"),
    ({"objects": [PLATE, CAN | {"radius": 0.05}, BOLTS], "kits": [TRAY | {"size": [0.4, 0.09], "slots": []}],
      "targets": [BOLT_AT | {"position": [0, 0, 0.0325]}]}, "objects[1].radius",
     "a radius of 0.05 m makes it 0.1 m wide and does not fit in the kit, 0.390 m between the walls"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "key", "problem"), CASES)
def test_an_invalid_kit_is_refused_in_one_sentence(tmp_path, change, key, problem):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(copy.deepcopy(KIT | change)))
    with pytest.raises(UserError) as error:
        load_task(path)
    message = str(error.value)
    assert message.startswith(f"{path}, key {key}: ")
    assert problem in message
    assert "\n" not in message
    assert not message.endswith(".")


def test_the_only_kit_has_slots_under_its_older_name_too():
    older = {key: value for key, value in KIT.items() if key not in ("extends", "kits")} | {"kit": TRAY}
    base = {key: value for key, value in load_task("kit4").to_dict().items() if key not in ("kits", "targets")}
    assert task_from_dict(base | older, source="mine").kits[0].slots[0].takes == "Plate"
    with pytest.raises(UserError, match=r"key kit\.slots\[0\]\.for: there is no object 'Cup'"):
        task_from_dict(base | older | {"kit": TRAY | {"slots": [TRAY["slots"][0] | {"for": "Cup"}]}}, source="mine")


def test_the_kit_of_these_tests_is_valid(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(copy.deepcopy(KIT)))
    assert load_task(path).episode.max_ticks == 15


@pytest.mark.parametrize(
    ("position", "turn"), [([-1.0, -1.0, 0.715], 45), ([-1.28, -1.0, 0.71], 0), ([-1.1, -1.0, 0.715], 90)]
)
def test_objects_may_start_in_a_kit_or_beside_it(tmp_path, position, turn):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(copy.deepcopy(KIT | fixed("Plate", position, turn))))
    assert load_task(path).layout.fixed[0].turn == turn


def test_targets_that_touch_or_lie_over_each_other_are_accepted(tmp_path):
    path = tmp_path / "mine.yaml"
    beside = AT | {"position": [-0.025, 0, 0.0525]}  # beside the narrow side of the turned plate
    above = BOLT_AT | {"position": [0, 0, 0.041], "frame": "Plate"}
    path.write_text(yaml.safe_dump(copy.deepcopy(KIT | targets(IN_SLOT, beside, above))))
    assert len(load_task(path).targets) == 3


@pytest.mark.parametrize("base", ["stack", "yumi_stack"])
def test_the_ticks_of_a_task_follow_from_its_own_targets(tmp_path, base):
    """Whatever it extends has fewer, and its other settings of an episode."""
    task = load_task(base)
    half = task.kits[0].inner[0] / 2
    places = [(x, y) for x in (-half, 0, half) for y in (-half, 0, half)]
    size = 0.4 * half
    boxes = [{"name": f"B{i}", "size": size, "color": RED} for i in range(8)]
    goals = [
        {"object": f"B{i}", "position": [x, y, task.kits[0].plate + size / 2], "frame": "KittingBox"}
        for i, (x, y) in enumerate(places[:8])
    ]
    path = tmp_path / "mine.yaml"
    own = {"boxes": boxes, "targets": goals, "layout": {"spacing": 2 * size}}
    path.write_text(yaml.safe_dump({"extends": base, "name": "mine"} | own))
    mine = load_task(path)
    assert mine.episode == dataclasses.replace(task.episode, max_ticks=40)
    assert task.episode.max_ticks == 15


@pytest.mark.parametrize(("ticks", "enough"), [(5, False), (6, True)])
def test_a_task_is_accepted_with_the_fewest_ticks_in_which_a_tree_solves_it(ticks, enough):
    task = load_task("stack")
    task = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=ticks))
    tree = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    assert play(semantics, Settler(task, Kinematic(task)), tree, sample_layouts(task, 0, 1)).solved == enough
    with contextlib.nullcontext() if enough else pytest.raises(UserError, match="5 ticks are too few"):
        check(task, "mine")


edges = st.floats(0.02, 0.2).map(lambda x: round(x, 3))
footprints = st.builds(
    lambda x, y, a, b, turn, is_round: Footprint((x, y), (a, a) if is_round else (a, b), turn, is_round),
    st.floats(-0.2, 0.2),
    st.floats(-0.2, 0.2),
    edges,
    edges,
    st.floats(-180, 180),
    st.booleans(),
)


@settings(max_examples=30)
@given(edges, edges, st.floats(0.1, 0.5), st.floats(0.1, 0.5), st.integers(1, 4), st.integers(1, 4), st.booleans())
def test_what_fits_in_a_slot_fits_in_every_turn_that_the_slot_leaves_open(edge, height, x, y, rows, columns, dividers):
    kit = Kit("Tray", (x, y), slots=(Slot("a", (0.0, 0.0)),), grid=(rows, columns), dividers=dividers)
    for slot in kit.places:
        for thing in (
            Object("A", (edge, edge, height), (1.0, 0.0, 0.0)),
            Object("A", (edge, edge / 2, height), (1.0, 0.0, 0.0)),
        ):
            told = slot_turn(kit, slot, thing)
            if fits(kit, slot, thing) and told is None:
                half = np.max([thing.half_at(float(turn))[:2] for turn in range(0, 91, 5)], axis=0)
                cell = np.divide(kit.inner, (columns, rows)) if slot not in kit.slots else kit.inner
                assert (half <= np.minimum(kit.room(slot), cell) + 1e-9).all()
            assert told is not None or thing.size[0] == thing.size[1]


def covers(one: Footprint, points: np.ndarray) -> np.ndarray:
    angle = np.radians(one.turn)
    turned = (points - one.middle) @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.hypot(*turned.T) <= one.half[0] if one.is_round else np.all(np.abs(turned) <= one.half, axis=1)


@given(footprints, footprints)
def test_footprints_overlap_where_they_have_points_in_common(one, other):
    depth = overlap(one, other)
    assert depth == pytest.approx(overlap(other, one), abs=1e-9)
    steps = np.arange(-0.5, 0.5, 0.01)
    points = np.array(list(itertools.product(steps, steps)))
    common = bool((covers(one, points) & covers(other, points)).any())
    assert depth > -1e-9 or not common
    assert depth < 0.04 or common  # a point of the lattice lies in what they share


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.tuples(edges, edges, st.sampled_from(["cuboid", "cylinder"])), min_size=1, max_size=12),
    st.integers(0, 1000),
)
def test_objects_of_a_task_that_is_accepted_have_room_to_start(sizes, seed):
    made = [
        {"name": f"Thing{i}", "color": RED}
        | ({"radius": a / 2, "height": b} if shape == "cylinder" else {"size": [a, min(b, 0.12), 0.05]})
        for i, (a, b, shape) in enumerate(sizes)
    ]
    base = load_task("kit4").to_dict() | {"gripper_opening": 0.2}
    base |= {"kits": [{"name": "Tray", "size": 0.5}], "objects": made}
    del base["episode"]
    data = base | {"targets": [{"object": "Thing0", "position": [0, 0, 0.1], "frame": "Tray"}]}
    with contextlib.suppress(UserError):
        task = task_from_dict(data, source="mine")
        try:
            layouts = sample_layouts(task, seed, 1)
        except UserError:
            pytest.fail("no room for the objects of a task that is accepted")
        assert np.isfinite(layouts.poses).all()
