import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.spoken_goals import completions, goal_sentence, read_goal
from bt_jax.tasks import Target, load_task, task_names
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from tests.helpers.trays import TRAYS

TASKS = [*map(load_task, task_names()), TRAYS]
STACK = load_task("stack")


@st.composite
def goals(draw):
    """A task, and a place for something in it: anywhere, or level with, or on, what is there."""
    task = draw(st.sampled_from(TASKS))
    kind = draw(st.sampled_from(task.kinds))
    thing = task.thing(kind)
    frame = draw(st.sampled_from([one for one in task.frames if one != thing.name]))
    if frame in task.instances and len(task.instances.get(task.thing(frame).part, ())) > 1:
        assume(draw(st.booleans()))
    unit = draw(st.sampled_from([thing.size[0] / 5, 0.001, task.genes.pitch or 0.1]))
    x, y, z = (unit * draw(st.one_of(st.integers(-6, 6), st.floats(-6, 6))) for _ in range(3))
    level = {name: kit.plate + thing.height / 2 for name, kit in zip(task.kit_names, task.kits, strict=True)}
    if frame == task.robot_frame:
        table = draw(st.sampled_from(task.tables))
        x, y = (a + b - c for a, b, c in zip((x, y), table.position[:2], task.robot_position[:2], strict=True))
        z += draw(st.sampled_from([0.0, table.top + thing.height / 2 - task.robot_position[2] - z]))
    elif frame in task.kit_names:
        z = draw(st.sampled_from([z, level[frame]]))
    else:
        other = task.thing(frame)
        z = draw(st.sampled_from([z, (thing.height + other.height) / 2, (thing.height - other.height) / 2]))
    turn = (
        draw(st.one_of(st.none(), st.integers(-180, 180).map(float), st.floats(-180, 180))) if thing.symmetry else None
    )
    return task, Target(kind, (x, y, z), frame, turn)


@settings(max_examples=400, deadline=None)
@given(goals())
def test_what_is_printed_is_read_back(case):
    task, target = case
    sentence = goal_sentence(task, target)
    assert goal_sentence(task, read_goal(task, sentence)) == sentence


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_targets_of_tasks_and_all_slots_are_read_back(task):
    for target in task.targets:
        read = read_goal(task, goal_sentence(task, target))
        assert (read.object, read.frame) == (target.object, target.frame)
        assert read.position == pytest.approx(target.position, abs=0.01)
    for kit in task.kits:
        for slot in kit.places:
            for kind in task.kinds:
                thing = task.thing(kind)
                if fits(kit, slot, thing):
                    turn = slot_turn(kit, slot, thing)
                    named = Target(kind, slot_position(kit, slot, thing), kit.name, turn, f"{kit.name}.{slot.name}")
                    assert read_goal(task, goal_sentence(task, named)) == named


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("put greenbox on yellowbox.", "GreenBox on top of YellowBox"),
        ("GreenBox should be to the right of  YellowBox", "GreenBox right of YellowBox"),
        ("GreenBox right of YellowBox, 3 cm away", "GreenBox right of YellowBox, 30 mm away"),
        ("GreenBox into the kit", "GreenBox in the middle of the kit"),
        ("GreenBox on TableLeft", "GreenBox in the middle of TableLeft"),
        ("GreenBox in the middle of KittingBox turned 30°", "GreenBox in the middle of the kit, turned by 30 degrees"),
    ],
)
def test_people_write_otherwise(written, printed):
    assert goal_sentence(STACK, read_goal(STACK, written)) == printed


@pytest.mark.parametrize("written", ["any Bolt into TrayA a2", "a bolt in TrayA.a2", "Bolt in slot a2 of TrayA"])
def test_any_of_a_part_goes_into_a_slot(written):
    assert read_goal(TRAYS, written).slot == "TrayA.a2"


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ("", "begin with what is to be moved; write for instance: "),
        ("RedBox on GreenBox", "begin with what is to be moved"),
        ("GreenBox", "is no place; write for instance: "),
        ("GreenBox over the moon", "“over the moon” is no place"),
        ("GreenBox on YelowBox", "there is no YelowBox here; use YellowBox"),
        ("GreenBox 1.2.3 cm above YellowBox", "1.2.3 is not a number"),
    ],
)
def test_what_says_nothing_is_answered(written, says):
    with pytest.raises(UserError) as caught:
        read_goal(STACK, written)
    assert says in str(caught.value)


def test_a_slot_or_an_object_that_is_not_clear_is_asked_for():
    with pytest.raises(UserError, match="TrayA has no slot b7; use one of a1, a2"):
        read_goal(TRAYS, "Can in TrayA b7")
    with pytest.raises(UserError, match="there are several Bolt; say which: Bolt1, Bolt2, Bolt3"):
        read_goal(TRAYS, "Cube on top of Bolt")


def test_sentences_are_completed():
    assert completions(STACK, "")[0].startswith("BlueBox ")  # what has no target yet
    assert completions(STACK, "green on top", 2) == ["GreenBox on top of YellowBox", "GreenBox on top of BlueBox"]
    assert completions(TRAYS, "any Bolt into TrayA a") == ["a Bolt in slot a2 of TrayA"]
    assert completions(STACK, "nothing of the kind") == []
    for sentence in completions(TRAYS, "", 1000):
        read_goal(TRAYS, sentence)
