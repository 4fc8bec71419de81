"""An image with what was detected in it, for people to look at."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Int

from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.perception.camera import CameraFrame
from bt_jax.deploy.perception.detection import Detection
from bt_jax.tasks import Task

__all__ = ["draw_detections"]

LINE, HALO = (255, 255, 255), (0, 0, 0)
Box = tuple[int, int, int, int]  # left, top, right, bottom, px
FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_detections(frame: CameraFrame, detections: Sequence[Detection], task: Task) -> ColorImage:
    """Return the image with the outline and the name of each detected object and kit of a task, at the pose that was
    detected: an outline beside the object shows the error of the detection."""
    image = frame.image.copy()
    unit = max(1, round(frame.image.shape[1] / 640))  # of the lines, px
    sizes = {thing.name: np.array(thing.size) for thing in task.objects}
    sizes |= {kit.name: np.array([*kit.size, kit.thickness]) for kit in task.kits}
    labels: list[Box] = []
    for found in detections:
        if found.body not in sizes:
            continue
        corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * sizes[found.body]
        seen = np.ascontiguousarray(found.pose.apply(corners))
        pixels, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), frame.matrix, frame.distortion)
        outline = cv2.convexHull(pixels.astype(np.float32)).round().astype(np.int32)
        cv2.polylines(image, [outline], isClosed=True, color=HALO, thickness=3 * unit, lineType=cv2.LINE_AA)
        cv2.polylines(image, [outline], isClosed=True, color=LINE, thickness=unit, lineType=cv2.LINE_AA)
        labels.append(_label(image, found.body, outline.reshape(-1, 2), unit, labels))
    return image


def _label(image: ColorImage, text: str, outline: Int[np.ndarray, "n 2"], unit: int, others: Sequence[Box]) -> Box:
    """Write a name under an outline, within the image and below the `others` that it would cover. Return where it is."""
    (width, height), below = cv2.getTextSize(text, FONT, 0.5 * unit, unit)
    left = int(np.clip(outline[:, 0].mean() - width / 2, 0, max(0, image.shape[1] - width)))
    bottom = int(np.clip(outline[:, 1].max() + height + 4 * unit, height, image.shape[0] - below))
    box = (left - unit, bottom - height - unit, left + width + unit, bottom + below)
    for other in sorted(others, key=lambda other: other[1]):
        if box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]:
            down = other[3] - box[1]
            box, bottom = (box[0], box[1] + down, box[2], box[3] + down), bottom + down
    cv2.rectangle(image, box[:2], box[2:], HALO, cv2.FILLED)
    cv2.putText(image, text, (left, bottom), FONT, 0.5 * unit, LINE, unit, cv2.LINE_AA)
    return box
