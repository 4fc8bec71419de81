"""A demonstration that a camera watches, in the cell or in the twin: its newest picture, and what was seen so far."""

from __future__ import annotations

import asyncio
import io
import re
import tempfile
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.yaml_files import to_yaml
from bt_jax.app.processes.subprocess import run_command
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.demonstration_library import DemonstrationLibrary
from bt_jax.app.state.edited_task import EditedTask
from bt_jax.app.state.workspace import Workspace

__all__ = ["CALIBRATION", "TWIN", "Watching"]

TWIN = "twin"
CALIBRATION = "camera.yaml"  # in the folder of the page: lens and place of the camera
PERIOD = 0.4  # seconds between two looks for a newer picture
WIDTH = 640  # pixels of the picture that is shown


class Watching:
    """`picture` is the newest picture (JPEG), None before the first; `said` is what was seen, a line each; both are those of
    the last demonstration once it is over. Changes are announced under the topic "watching"."""

    def __init__(self, bus: Bus, workspace: Workspace, edited: EditedTask, library: DemonstrationLibrary) -> None:
        self.picture: bytes | None = None
        self.said: tuple[str, ...] = ()
        self._bus, self._workspace, self._edited, self._library = bus, workspace, edited, library
        self._end: asyncio.Event | None = None

    @property
    def on(self) -> bool:
        """Whether a camera is watching."""
        return self._end is not None

    async def watch(self, camera: str) -> str:
        """Watch one demonstration of the edited task with a camera, given by its number, or in the twin; keep it in the set
        that is chosen, and return its name. Raise UserError if none is kept."""
        if self.on:
            raise UserError("a camera is watching already; end that demonstration first")
        calibration, folder = self._workspace.root / CALIBRATION, self._library.folder
        if camera != TWIN and not calibration.is_file():
            raise UserError(
                "lens and place of the camera are not known; calibrate it with python -m bt_jax.deploy calibrate, and put "
                f"its file into the folder of the page as {CALIBRATION}"
            )
        before = folder.names() if folder.path.is_dir() else []
        self._end, self.said, self.picture = asyncio.Event(), (), None
        self._bus.changed("watching")
        try:
            with tempfile.TemporaryDirectory(prefix="bt_jax-") as scratch:
                source, film = Path(scratch) / f"{self._edited.task.name}.yaml", Path(scratch) / "film"
                write_atomic(source, to_yaml(self._edited.task.to_dict()))
                words = [str(folder.path), "--watch", "--camera", camera, "--task", str(source), "--count", "1"]
                words += ["--unclear", "usual", "--record", str(film)]
                words += [] if camera == TWIN else ["--calibration", str(calibration)]
                looking = asyncio.create_task(self._look(film))
                try:
                    await run_command(
                        "bt_jax.demonstrate",
                        words,
                        otherwise="watching has ended without a demonstration; try again",
                        say=self._hear,
                        interrupt=self._end,
                    )
                finally:
                    looking.cancel()
        finally:
            self._end = None
            self._bus.changed("watching")
            await self._library.refresh()
        return next((name for name in folder.names() if name not in before), "")

    def end(self) -> None:
        """End the demonstration: what was seen by now counts."""
        if self._end is not None:
            self._end.set()

    def _hear(self, line: str) -> None:
        if re.match(r"\d+\.\d s", line):  # what else is printed is for a terminal
            self.said = (*self.said, line)
            self._bus.changed("watching")

    async def _look(self, film: Path) -> None:
        """Show the newest picture of a film in the making; the older ones go."""
        while True:
            newest = await asyncio.to_thread(_newest, film)
            if newest is not None:
                self.picture = newest
                self._bus.changed("watching")
            await asyncio.sleep(PERIOD)


def _newest(film: Path) -> bytes | None:
    """Return the newest picture of a recording, smaller, and delete those before it; None if there is none yet."""
    found = sorted(film.glob("film*/*.png"))
    if not found:
        return None
    from PIL import Image  # comes with the extra `robot`, as whatever has written the picture

    with Image.open(found[-1]) as picture:
        picture.thumbnail((WIDTH, WIDTH))
        small = io.BytesIO()
        picture.convert("RGB").save(small, "JPEG", quality=80)
    for path in found[:-1]:
        path.unlink(missing_ok=True)
    return small.getvalue()
