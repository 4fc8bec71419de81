"""`python -m bt_jax.deploy markers`: the markers of a task and the calibration board, to be printed at true scale."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.deploy.commands.arguments import MarkersArguments
from bt_jax.deploy.execution.program import refuse_driving
from bt_jax.deploy.perception.calibration import BOARD, SQUARE, charuco_board
from bt_jax.deploy.perception.markers import MODULES, Marker, marker_image, task_markers
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.marker_scene import tint
from bt_jax.tasks import Task, load_task

__all__ = ["markers_command", "sheet_pages"]

PAGES = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # mm
DPI = 300
BORDER, GAP, LABEL, FOOT = 12.0, 5.0, 7.0, 22.0  # mm: around the page, between stickers, for their names, for the scale
INCH = 25.4
SIDES = {"right": "+X", "left": "-X", "up": "+Y", "down": "-Y", "front": "+Z", "back": "-Z"}


def markers_command(arguments: MarkersArguments) -> int:
    """Write the sheets; the exit code is 0. Raise UserError."""
    pages = list(sheet_pages(refuse_driving(load_task(arguments.task)), arguments.paper))
    document = io.BytesIO()
    with PdfPages(document) as pdf:
        for page in pages:
            pdf.savefig(page)
    write_atomic(arguments.out / "markers.pdf", document.getvalue())
    for number, page in enumerate(pages, start=1):
        picture = io.BytesIO()
        page.savefig(picture, format="png", dpi=DPI)
        write_atomic(arguments.out / f"markers_{number}.png", picture.getvalue())
    Console(highlight=False).print(
        f"{len(pages)} pages in {arguments.out}: print at 100 %, check the scale with a ruler, cut along the lines; "
        "matte paper"
    )
    return 0


def sheet_pages(task: Task, paper: str = "a4") -> Iterator[Figure]:
    """Yield pages of the paper: stickers row by row, those of an object on its colour, and last the calibration board.

    Raise UserError if a sticker is larger than the paper.
    """
    if paper not in PAGES:
        raise UserError(f"paper '{paper}' is unknown; use one of {', '.join(PAGES)}")
    width, height = PAGES[paper]
    colors = {thing.name: tint(thing.color) for thing in task.objects}
    discs = {thing.name for thing in task.objects if thing.shape == "cylinder"}
    for stickers in _pages(task_markers(task), width, height):
        page, paint = _blank(width, height, f"{task.name}: markers")
        for marker, left, top in stickers:
            color = colors.get(marker.body, (1.0, 1.0, 1.0))
            _sticker(paint, marker, left, height - top, color, disc=marker.body in discs)
        yield page
    yield _board_page(width, height)


def _pages(markers: Sequence[Marker], width: float, height: float) -> Iterator[list[tuple[Marker, float, float]]]:
    """Yield the stickers of each page with their left and top edges, mm from the page's upper left corner."""
    page: list[tuple[Marker, float, float]] = []
    left, top, row, body = BORDER, BORDER + LABEL, 0.0, ""
    for marker in markers:
        edge = 1000 * marker.sticker
        if edge > width - 2 * BORDER:
            raise UserError(
                f"the markers of {marker.body} are {edge:.0f} mm wide and the paper is not; use smaller objects"
            )
        if left + edge > width - BORDER or (body and marker.body != body):
            left, top, row = BORDER, top + row + GAP + LABEL, 0.0
        if page and top + edge + LABEL > height - FOOT:
            yield page
            page, left, top, row = [], BORDER, BORDER + LABEL, 0.0
        page.append((marker, left, top))
        left, row, body = left + edge + GAP, max(row, edge), marker.body
    yield page


def _blank(width: float, height: float, title: str) -> tuple[Figure, Axes]:
    """Return an empty page with its title and a scale of 100 mm, and axes in millimetres, origin bottom left."""
    page = Figure(figsize=(width / INCH, height / INCH))
    FigureCanvasAgg(page)
    paint = page.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    paint.set_axis_off()
    paint.text(BORDER, height - 8, title, fontsize=9)
    paint.plot([BORDER, BORDER + 100], [12, 12], color="black", linewidth=0.6, solid_capstyle="butt")
    for tick in range(0, 101, 10):
        paint.plot([BORDER + tick] * 2, [12, 14 if tick % 50 else 15.5], color="black", linewidth=0.4)
    paint.text(BORDER + 104, 11, "100 mm: measure it after printing", fontsize=7)
    return page, paint


def _sticker(
    paint: Axes, marker: Marker, left: float, top: float, color: tuple[float, float, float], *, disc: bool
) -> None:
    edge = 1000 * marker.sticker
    module = edge / (MODULES + 2 * marker.quiet)
    middle = left + edge / 2, top - edge / 2
    outline = Circle(middle, edge / 2) if disc else Rectangle((left, top - edge), edge, edge)
    outline.set(facecolor=color, edgecolor="0.6", linewidth=0.3)
    paint.add_patch(outline)
    bits = marker_image(marker.id, marker.quiet, 1)
    for row, line in enumerate(bits):
        for first, last in _runs(line == 0):
            corner = (left + first * module, top - (row + 1) * module)
            paint.add_patch(
                Rectangle(corner, (last - first) * module, module, facecolor="black", edgecolor="black", linewidth=0.05)
            )
    name = f"{marker.id} {marker.body} {SIDES.get(marker.face, marker.face)}, arrow to {_axis(marker.axes[:, 1])}"
    paint.text(left, top - edge - 3.2, name, fontsize=5.5)
    paint.annotate(
        "",
        (left + edge / 2, top + 2.2),
        (left + edge / 2, top + 0.2),
        arrowprops={"width": 0.2, "headwidth": 2, "headlength": 2, "color": "0.5"},
    )


def _axis(direction: Point) -> str:
    """Return the axis that a direction of the box's frame is along, as "+X"."""
    index = int(np.argmax(np.abs(direction)))
    return "+-"[int(direction[index] < 0)] + "XYZ"[index]


def _runs(dark: Bool[np.ndarray, " n"]) -> Iterator[tuple[int, int]]:
    first = None
    for column, value in enumerate([*dark, False]):
        if value and first is None:
            first = column
        elif not value and first is not None:
            yield first, column
            first = None


def _board_page(width: float, height: float) -> Figure:
    page, paint = _blank(
        width, height, f"calibration board, squares of {1000 * SQUARE:g} mm: glue it to something flat"
    )
    across, down = (1000 * SQUARE * count for count in BOARD)
    per_square = 96
    image = charuco_board().generateImage((BOARD[0] * per_square, BOARD[1] * per_square), marginSize=0, borderBits=1)
    left, bottom = (width - across) / 2, (height - down + 10) / 2
    paint.imshow(
        image, cmap="gray", extent=(left, left + across, bottom, bottom + down), interpolation="none", aspect="auto"
    )
    paint.set(xlim=(0, width), ylim=(0, height))
    return page
