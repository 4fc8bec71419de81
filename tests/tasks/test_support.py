import dataclasses

import pytest

from bt_jax._util.errors import UserError
from bt_jax.tasks import load_task, task_names
from bt_jax.tasks.support import unsupported
from bt_jax.tasks.task import Target

KIT, BASE = "KittingBox", "base_link"


def found(*targets, base="stack3"):
    task = load_task(base)
    made = tuple(Target(name, position, frame) for name, position, frame in targets)
    return [(i, pytest.approx(z, abs=1e-6)) for i, z in unsupported(dataclasses.replace(task, targets=made))]


@pytest.mark.parametrize("name", task_names())
def test_the_packaged_targets_rest_on_something(name):
    assert list(unsupported(load_task(name))) == []


@pytest.mark.parametrize(
    "target",
    [
        (0.0, 0.0, 0.052, KIT),
        (0.0, 0.0, 0.252, KIT),  # on the two other boxes, which have no target
        (0.3, 0.0, 0.048, KIT),  # beside the kit, on its table
        (1.0, 0.0, 0.048, KIT),  # on the next table
        (0.0, -1.0, 0.75, BASE),
        (0.0, -0.5, 0.0, BASE),  # on the floor
        (0.12, 0.0, 0.0, "GreenBox"),
        (0.12, 0.0, -0.2, "GreenBox"),  # GreenBox may stand high
        (0.0, 0.0, 0.12, "GreenBox"),  # it falls by less than the tolerance
    ],
)
def test_where_something_may_be_below_a_target_is_accepted(target):
    *position, frame = target
    assert found(("YellowBox", tuple(position), frame)) == []


@pytest.mark.parametrize(
    ("target", "z"),
    [
        ((0.0, 0.0, 0.5, KIT), 0.2925),  # on the other two and the wall
        ((0.0, 0.0, 1.0, "GreenBox"), 0.2),
        ((0.0, -1.0, 0.4, BASE), 0.2),  # inside a table: between the floor with two boxes and the top
        ((3.0, -1.0, 0.75, BASE), 0.2),  # beside the tables
    ],
)
def test_a_target_in_the_air_is_found_with_the_nearest_height(target, z):
    *position, frame = target
    assert found(("YellowBox", tuple(position), frame)) == [(0, z)]


def test_boxes_with_targets_hold_others():
    below = [("YellowBox", (-0.133, 0.0, 0.052), KIT), ("BlueBox", (0.0, 0.0, 0.052), KIT)]
    assert found(*below, ("GreenBox", (-0.065, 0.0, 0.152), KIT)) == []
    assert found(*below, ("GreenBox", (0.1, 0.1, 0.152), KIT)) == [(2, 0.0925)]
    assert found(*below, ("GreenBox", (0.0, 0.2, 0.1), "BlueBox")) == [(2, 0.0405)]


def test_the_file_says_so_and_an_unfinished_task_is_opened(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "extends: stack\nname: mine\ntargets: [{object: YellowBox, position: [0, 0, 5.2], frame: KittingBox}]\n"
    )
    with pytest.raises(UserError) as error:
        load_task(path)
    assert str(error.value) == (
        f"{path}, key targets[0].position: nothing can be under YellowBox there, which must rest on something; write 0.2925 "
        "for z, or another place"
    )
    assert load_task(path, unfinished=True).targets[0].position == (0.0, 0.0, 5.2)
