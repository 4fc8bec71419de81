"""The markers in the twin: textures for the boxes' faces, and stickers on the kit's plate."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

from bt_jax.deploy.perception.markers import Marker, marker_image, task_markers
from bt_jax.tasks import Task

__all__ = ["MarkerScene", "marker_scene", "tint"]

MODULE = 32  # pixels of a texture
PAPER = 0.00005  # thickness of a sticker on the kit, m
BRIGHT = 0.75  # least luminance of the paper: the detector needs the contrast
WHITE = (0.75, 0.75, 0.75)  # paper that the scene's light does not overexpose, which would move the edges


@dataclasses.dataclass(frozen=True)
class MarkerScene:
    """Parts of an MJCF: `assets_xml` belongs inside <asset>, `kit_xml` inside the kit's body; `files` are the PNGs that
    they name, for `MjModel.from_xml_string(xml, assets=files)`. A box's geom takes the material `NAME_markers`."""

    assets_xml: str
    kit_xml: str
    files: dict[str, bytes]


def marker_scene(task: Task) -> MarkerScene:
    """Return what a scene needs so that its camera sees the markers of a task."""
    colors = {box.name: tint(box.color) for box in task.objects}
    markers = task_markers(task)
    files = {_file(marker): _texture(marker, colors.get(marker.body, WHITE)) for marker in markers}
    assets = []
    for box in task.objects:
        faces = " ".join(f'file{marker.face}="{_file(marker)}"' for marker in markers if marker.body == box.name)
        assets.append(f'<texture name="{box.name}_markers" type="cube" {faces}/>')
        assets.append(_material(f"{box.name}_markers"))
    on_kit = [marker for marker in markers if marker.body == task.kit.name]
    for marker in on_kit:
        name = f"{marker.body}_{marker.face}"
        assets.append(f'<texture name="{name}" type="cube" file="{_file(marker)}"/>')
        assets.append(_material(name))
    return MarkerScene("\n".join(assets), "\n".join(map(_sticker, on_kit)), files)


def tint(color: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the colour mixed with as much white as its luminance needs to reach that of paper."""
    luminance = float(np.dot(color, (0.299, 0.587, 0.114)))
    white = max(0.0, (BRIGHT - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (part + white * (1 - part) for part in color)
    return red, green, blue


def _file(marker: Marker) -> str:
    return f"marker_{marker.id}.png"


def _texture(marker: Marker, color: tuple[float, float, float]) -> bytes:
    gray = marker_image(marker.id, marker.quiet, MODULE)[:, :, None] / 255 * np.array(color[::-1])
    return cv2.imencode(".png", np.rint(255 * gray).astype(np.uint8))[1].tobytes()


def _material(name: str) -> str:
    return f'<material name="{name}" texture="{name}" specular="0" shininess="0"/>'


def _sticker(marker: Marker) -> str:
    half = marker.sticker / 2
    x, y, z = marker.pose.translation
    return (
        f'<geom name="{marker.body}_{marker.face}" type="box" contype="0" conaffinity="0" group="2" mass="0" '
        f'size="{half:.6g} {half:.6g} {PAPER / 2:.6g}" pos="{x:.6g} {y:.6g} {z + PAPER / 2:.6g}" '
        f'material="{marker.body}_{marker.face}"/>'
    )
