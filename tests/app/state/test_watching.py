"""A camera that watches a demonstration, without one."""

import asyncio
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bt_jax._util.errors import UserError
from bt_jax.app.state import watching
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task
from tests.helpers.asynchronous import in_loop

TASK = load_task("stack")


@pytest.fixture
def command(monkeypatch):
    """What the command is told; it says one line, films one picture, and keeps a demonstration once it is interrupted."""
    told = []

    async def run(module, words, *, say, interrupt, **_):
        told[:] = [module, *words]
        film = Path(words[words.index("--record") + 1]) / "film1"
        film.mkdir(parents=True)
        for number in range(2):
            Image.new("RGB", (1280, 720), (200, 100, 0)).save(film / f"{number:06d}.png")
        say("0.6 s  start: all boxes are at rest")
        await interrupt.wait()
        assert [path.name for path in film.iterdir()] == ["000001.png"]  # what was shown is deleted
        folder = DemonstrationFolder(Path(words[0]))
        folder.create(Frames.of(TASK))
        target = Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox")
        (one,) = demonstration_set(TASK, [target], count=1, rng=np.random.default_rng(0))
        folder.append(one)
        say("learn from them with python -m bt_jax.learn")

    monkeypatch.setattr(watching, "run_command", run)
    monkeypatch.setattr(watching, "PERIOD", 0.01)
    return told


@in_loop
async def test_what_is_watched_is_shown_and_kept(studio, command):
    watched = asyncio.ensure_future(studio.watching.watch("twin"))
    while studio.watching.picture is None:
        await asyncio.sleep(0.01)
    assert studio.watching.on
    assert Image.open(io.BytesIO(studio.watching.picture)).size == (640, 360)
    with pytest.raises(UserError, match="watching already; end that demonstration first"):
        await studio.watching.watch("twin")
    studio.watching.end()
    assert await watched == "demo1"
    assert not studio.watching.on
    assert studio.watching.said == ("0.6 s  start: all boxes are at rest",)
    assert [one.name for one in studio.library.kept] == ["demo1"]
    assert command[0] == "bt_jax.demonstrate"
    assert "--calibration" not in command


@in_loop
async def test_a_camera_needs_to_be_calibrated(studio, command, tmp_path):
    with pytest.raises(UserError, match="calibrate it with python -m"):
        await studio.watching.watch("0")
    (tmp_path / "camera.yaml").write_text("lens: known")
    watched = asyncio.ensure_future(studio.watching.watch("0"))
    while studio.watching.picture is None:
        await asyncio.sleep(0.01)
    studio.watching.end()
    await watched
    assert command[command.index("--calibration") + 1] == str(tmp_path / "camera.yaml")
