import xml.etree.ElementTree as ElementTree

import pytest

from bt_jax.app.state.kit.new import new_kit
from bt_jax.app.task_picture import task_picture
from bt_jax.tasks import load_task, task_names
from tests.helpers.trays import TRAYS

SVG = "{http://www.w3.org/2000/svg}"


def css(color, bright):
    return "#" + "".join(f"{round(255 * bright * part):02x}" for part in color)


@pytest.mark.parametrize("task", [*map(load_task, task_names()), TRAYS, new_kit([])], ids=lambda task: task.name)
def test_everything_that_has_a_place_is_in_the_picture(task):
    picture = ElementTree.fromstring(task_picture(task))
    fills = {element.get("fill") for element in picture}
    for target in task.targets:
        assert css(task.thing(target.object).color, 1.0) in fills
    left, top, width, height = map(float, picture.get("viewBox").split())
    for polygon in picture.iter(f"{SVG}polygon"):
        for point in polygon.get("points").split():
            x, y = map(float, point.split(","))
            assert left <= x <= left + width
            assert top <= y <= top + height


def test_what_is_on_top_is_drawn_after_what_carries_it():
    task = load_task("pyramid")
    picture = ElementTree.fromstring(task_picture(task))
    fills = [element.get("fill") for element in picture]
    tops = [fills.index(css(task.thing(target.object).color, 1.0)) for target in task.targets]
    assert max(tops) == tops[[target.object for target in task.targets].index("GreenBox")]
