import dataclasses

import cv2
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import MarkersArguments
from bt_jax.deploy.commands.markers import DPI, markers_command, sheet_pages
from bt_jax.deploy.perception.markers import marker_dictionary, task_markers
from bt_jax.tasks import load_task

PIXEL = 0.0254 / DPI


@pytest.mark.parametrize("task", ["yumi_stack"])
def test_every_marker_is_on_the_print_once_at_true_scale(tmp_path, task):
    assert markers_command(MarkersArguments(task=task, out=tmp_path)) == 0
    detector = cv2.aruco.ArucoDetector(marker_dictionary())
    sizes: dict[int, list[float]] = {}
    for page in sorted(tmp_path.glob("*.png")):
        quads, ids, _ = detector.detectMarkers(cv2.imread(str(page), cv2.IMREAD_GRAYSCALE))
        for number, quad in zip([] if ids is None else np.ravel(ids).tolist(), quads, strict=True):
            edges = np.linalg.norm(np.diff(np.vstack([quad.reshape(4, 2), quad.reshape(4, 2)[:1]]), axis=0), axis=1)
            sizes.setdefault(number, []).append(float(edges.mean()) * PIXEL)
    for marker in task_markers(load_task(task)):
        assert sizes[marker.id] == [pytest.approx(marker.size, abs=3 * PIXEL)]
    assert (tmp_path / "markers.pdf").read_bytes().startswith(b"%PDF")


def test_the_document_has_the_size_of_the_paper(tmp_path):
    markers_command(MarkersArguments(out=tmp_path, paper="letter"))
    assert b"/MediaBox [ 0 0 612 792 ]" in (tmp_path / "markers.pdf").read_bytes()


@pytest.mark.parametrize(("arguments", "message"), [({"paper": "a0"}, "paper"), ({"task": "none"}, "unknown task")])
def test_what_cannot_be_printed_is_told(tmp_path, arguments, message):
    with pytest.raises(UserError, match=message):
        markers_command(MarkersArguments(out=tmp_path, **arguments))


def test_markers_wider_than_the_paper_are_refused():
    task = load_task("stack")
    huge = dataclasses.replace(
        task, objects=tuple(dataclasses.replace(box, size=(0.3, 0.3, 0.3)) for box in task.objects)
    )
    huge = dataclasses.replace(huge, kits=(dataclasses.replace(task.kits[0], size=(0.7, 0.7)),))
    with pytest.raises(UserError, match="wide"):
        list(sheet_pages(huge))
