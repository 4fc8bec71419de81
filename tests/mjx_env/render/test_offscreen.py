import imageio.v3 as imageio
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.render.offscreen import GripperPose, Renderer, available, contact_sheet, write_film
from bt_jax.tasks import load_task
from bt_jax.tasks.support import kit_origin

needs_graphics = pytest.mark.skipif(available() is not True, reason=str(available()))


def layout(task, table=1):
    kit = np.array([kit_origin(task, task.tables[table])])
    poses = np.zeros((len(task.objects), 7))
    for i, box in enumerate(task.objects):
        place = task.tables[i % len(task.tables)]
        poses[i] = (*place.position[:2], place.top + box.edge / 2, 1, 0, 0, 0)
    return kit, poses


@needs_graphics
@pytest.mark.parametrize("name", ["stack3", "yumi_stack"])
@pytest.mark.parametrize("size", [(320, 180), (160, 120)])
def test_every_table_is_in_the_picture(name, size):
    task = load_task(name)
    kit, poses = layout(task)
    with Renderer(task, width=size[0], height=size[1]) as draw:
        seen = draw(kit, poses)
        assert seen.shape == (size[1], size[0], 3)
        for i in range(len(task.objects)):
            hidden = poses.copy()
            hidden[i, 2] -= 1000
            assert (draw(kit, hidden) != seen).any(), f"box {i} cannot be seen"
        np.testing.assert_array_equal(draw(kit, poses), seen)


@needs_graphics
def test_gripper_shows_only_where_it_is_asked_for():
    task = load_task("stack3")
    kit, poses = layout(task)
    with Renderer(task, width=160, height=90, samples=0) as draw:
        without = draw(kit, poses)
        opened = draw(kit, poses, GripperPose((0.0, 0.0, 1.0), opening=0.15))
        closed = draw(kit, poses, GripperPose((0.0, 0.0, 1.0), opening=0.1))
        np.testing.assert_array_equal(draw(kit, poses), without)
    assert (opened != without).any()
    assert (opened != closed).any()


def frames(count=7):
    ramp = np.linspace(0, 255, count).astype(np.uint8)
    return [np.full((32, 48, 3), value) for value in ramp]


@pytest.mark.parametrize("ending", ["mp4", "gif", "png"])
def test_films_can_be_read_back(tmp_path, ending):
    path = tmp_path / f"film.{ending}"
    write_film(path, frames(), fps=10)
    film = imageio.imread(path)
    if ending == "png":
        np.testing.assert_array_equal(film, contact_sheet(frames()))
    else:
        assert film.shape[-3:] == (32, 48, 3)
        assert len(film) == 7


def test_contact_sheet_goes_from_first_to_last():
    sheet = contact_sheet(frames(), columns=3, rows=2, gap=4)
    assert sheet.shape == (32 * 2 + 4, 48 * 3 + 8, 3)
    assert (sheet[0, 0] == 0).all()
    assert (sheet[-1, -1] == 255).all()


def test_film_errors_say_what_to_do(tmp_path):
    with pytest.raises(UserError, match="at least one frame"):
        write_film(tmp_path / "film.mp4", [])
    with pytest.raises(UserError, match=r"\.mp4, \.gif or \.png"):
        write_film(tmp_path / "film.avi", frames())
    with pytest.raises(UserError, match="cannot be written"):
        write_film(tmp_path / "missing" / "film.png", frames())
