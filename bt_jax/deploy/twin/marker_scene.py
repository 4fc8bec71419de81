"""The markers in the twin: textures for the faces of cubes, and stickers on other objects and on the plates of kits."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import cv2
import numpy as np

from bt_jax.deploy.perception.markers import MODULES, Marker, marker_image, task_markers
from bt_jax.tasks import Task

__all__ = ["MarkerScene", "marker_scene", "tint"]

MODULE = 32  # pixels of a texture
PAPER = 0.00005  # thickness of a sticker, m
DISC = 0.5  # modules of bright margin of a square that lies in a cylinder's top, which is as bright around it
BRIGHT = 0.75  # least luminance of the paper: the detector needs the contrast
WHITE = (0.75, 0.75, 0.75)  # paper that the scene's light does not overexpose, which would move the edges


@dataclasses.dataclass(frozen=True)
class MarkerScene:
    """Parts of an MJCF: `assets_xml` belongs inside <asset>, `stickers` inside the bodies named; `files` are the PNGs that
    they name, for `MjModel.from_xml_string(xml, assets=files)`. An object's geom takes the material `NAME/markers`."""

    assets_xml: str
    stickers: dict[str, str]
    files: dict[str, bytes]

    def add_to(self, root: ET.Element) -> None:
        """Put the markers into the scene of their task."""
        assets = root.find("asset")
        assert assets is not None, "the scene has no assets"
        assets.extend(ET.fromstring(f"<asset>{self.assets_xml}</asset>"))
        for name, xml in self.stickers.items():
            body = root.find(f".//body[@name='{name}']")
            assert body is not None, f"the scene has no {name}"
            body.extend(ET.fromstring(f"<body>{xml}</body>"))
            for geom in body.iterfind(f"geom[@name='{name}']"):
                geom.set("material", f"{name}/markers")


def marker_scene(task: Task) -> MarkerScene:
    """Return what a scene needs so that its camera sees the markers of a task."""
    colors = {thing.name: tint(thing.color) for thing in task.objects}
    markers: dict[str, list[Marker]] = {name: [] for name in (*task.object_names, *task.kit_names)}
    for marker in task_markers(task):
        markers[marker.body].append(marker)
    discs = [thing.name for thing in task.objects if thing.shape == "cylinder"]
    files, assets, stickers = {}, [], {}
    for name, own in markers.items():
        for marker in own:
            quiet = DISC if name in discs else marker.quiet
            files[_file(marker)] = _texture(marker, quiet, colors.get(name, WHITE))
        stickers[name] = ""
        if name in task.object_names and task.thing(name).is_cube:
            faces = " ".join(f'file{marker.face}="{_file(marker)}"' for marker in own)
            assets += [f'<texture name="{name}/markers" type="cube" {faces}/>', _material(f"{name}/markers")]
            continue
        if name in colors:
            rgba = " ".join(f"{part:.6g}" for part in colors[name])
            assets.append(f'<material name="{name}/markers" rgba="{rgba} 1" specular="0" shininess="0"/>')
        for marker in own:
            sticker = f"{name}/{marker.face}"
            assets += [f'<texture name="{sticker}" type="cube" file="{_file(marker)}"/>', _material(sticker)]
            quiet = DISC if name in discs else marker.quiet
            stickers[name] += _sticker(marker, marker.size * (1 + 2 * quiet / MODULES))
    return MarkerScene("\n".join(assets), stickers, files)


def tint(color: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the colour mixed with as much white as its luminance needs to reach that of paper."""
    luminance = float(np.dot(color, (0.299, 0.587, 0.114)))
    white = max(0.0, (BRIGHT - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (part + white * (1 - part) for part in color)
    return red, green, blue


def _file(marker: Marker) -> str:
    return f"marker_{marker.id}.png"


def _texture(marker: Marker, quiet: float | int, color: tuple[float, float, float]) -> bytes:
    gray = marker_image(marker.id, quiet, MODULE)[:, :, None] / 255 * np.array(color[::-1])
    return cv2.imencode(".png", np.rint(255 * gray).astype(np.uint8))[1].tobytes()


def _material(name: str) -> str:
    return f'<material name="{name}" texture="{name}" specular="0" shininess="0"/>'


def _sticker(marker: Marker, edge: float) -> str:
    """Return a square of paper with its own z out of the surface."""
    half = edge / 2
    x, y, z = marker.place(np.zeros((1, 2)))[0] + PAPER / 2 * marker.axes[:, 2]
    quat = " ".join(f"{part:.9g}" for part in marker.pose.rotation.as_quat(scalar_first=True))
    return (
        f'<geom name="{marker.body}/{marker.face}" type="box" contype="0" conaffinity="0" group="2" mass="0" '
        f'size="{half:.6g} {half:.6g} {PAPER / 2:.6g}" pos="{x:.6g} {y:.6g} {z:.6g}" quat="{quat}" '
        f'material="{marker.body}/{marker.face}"/>'
    )
