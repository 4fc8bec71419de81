import dataclasses
import re
from pathlib import Path

import pytest

from bt_jax._util.errors import UserError
from bt_jax.tasks import Base, Faults, Robot, load_task, task_names
from bt_jax.tasks.bounds import BOUNDS, numbers, out_of_bounds
from bt_jax.tasks.task import Target
from bt_jax.tasks.things import Object, Slot


def test_every_number_of_a_task_has_a_bound():
    task = load_task("stack")
    fixed = (Target("YellowBox", (0.0, 0.0, 0.0), "base_link", 90.0),)
    task = dataclasses.replace(
        task,
        layout=dataclasses.replace(task.layout, fixed=fixed),
        objects=(*task.objects, Object("Can", (0.06, 0.06, 0.1), (1.0, 0.0, 0.0), shape="cylinder")),
        kits=(dataclasses.replace(task.kits[0], slots=(Slot("a1", (0.0, 0.0)),), grid=(1, 1)),),
        targets=(dataclasses.replace(task.targets[0], turn=90.0),),
        faults=Faults(),
        robot=Robot(Base(0.9, stations=((0.0, 1.0),))),
    )
    assert {name for _, name, _ in numbers(task, "", "")} == set(BOUNDS)


def test_the_tutorial_has_the_table_of_bounds():
    text = (Path(__file__).parents[2] / "docs" / "tutorials" / "own_task.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*`) \| ([-\d.,]+) to ([\d.,]+)(.*) \|$", text, re.MULTILINE)
    bounds = [(low, high, unit.strip(), key) for keys, low, high, unit in rows for key in re.findall("`(.*?)`", keys)]
    found = {key: (float(low.replace(",", "")), float(high.replace(",", "")), unit) for low, high, unit, key in bounds}
    assert found == {key: (bound.low, bound.high, bound.unit) for key, bound in BOUNDS.items()}


@pytest.mark.parametrize("name", task_names())
def test_the_packaged_tasks_are_plausible(name):
    assert list(out_of_bounds(load_task(name))) == []


CASES = [
    ("boxes: [{name: A, size: 0.0003, color: [1, 0, 0]}]", "boxes[0].size: 0.0003 is implausible; write 0.005 to 2 m"),
    ("boxes: [{name: A, size: 40, color: [1, 0, 0]}]", "boxes[0].size: 40 is implausible; write 0.005 to 2 m "
     "(metres? 40 mm are 0.04 m)"),
    ("boxes: [{name: A, size: 0.1, color: [255, 0, 0]}]", "boxes[0].color[0]: 255 is implausible; write 0 to 1 "
     "(255 of 255 are 1)"),
    ("boxes: [{name: A, size: 0.1, color: [1, 0, 0], density: 1e+30}]", "boxes[0].density: 1e+30 is implausible; write 10 "
     "to 25000 kg/m³"),
    ("boxes: [{name: A, size: 0.1, color: [1, 0, 0], density: 0.7}]", "(0.7 g/cm³ are 700 kg/m³)"),
    ("targets: [{object: YellowBox, position: [0, 0, 52], frame: KittingBox}]", "targets[0].position[2]: 52 is implausible; "
     "write -10 to 10 m (metres? 52 mm are 0.052 m)"),
    ("tables: [{name: Left, position: [-1000, 0, 375], size: [1, 1, 1]}]", "metres? -1000 mm are -1 m"),
    ("kit: {wall_height: 40}", "kit.wall_height: 40 is implausible; write 0.0005 to 2 m (metres? 40 mm are 0.04 m)"),
    ("layout: {margin: 125}", "layout.margin: 125 is implausible"),
    ("layout: {kit: TableLeft, fixed: [{object: YellowBox, position: [0, -1000, 750], frame: base_link}]}",
     "layout.fixed[0].position[1]: -1000 is implausible"),
    ("genes: {pitch: 133}", "genes.pitch: 133 is implausible"),
    ("episode: {tolerance: 30}", "episode.tolerance: 30 is implausible; write 0.0001 to 1 m (metres? 30 mm are 0.03 m)"),
    ("episode: {max_ticks: 1000000}", "episode.max_ticks: 1e+06 is implausible; write 1 to 10000 ticks"),
    ("robot_position: [0, 1000, 50]", "robot_position[1]: 1000 is implausible"),
    ("gripper_opening: 50", "gripper_opening: 50 is implausible; write 0.005 to 2 m (metres? 50 mm are 0.05 m)"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "complaint"), CASES)
def test_an_implausible_number_is_refused_with_its_range_and_the_unit_that_explains_it(tmp_path, line, complaint):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: stack\nname: mine\n{line}\n")
    with pytest.raises(UserError) as error:
        load_task(path)
    assert str(error.value).startswith(f"{path}, key ")
    assert complaint in str(error.value)
