"""The camera that films a person's demonstration in the twin, as fast as it can be drawn."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from jaxtyping import Float

from bt_jax.deploy.perception.camera import CameraFrame
from bt_jax.deploy.perception.film import FilmEnded
from bt_jax.deploy.twin.cell import CAMERA, TwinScene
from bt_jax.deploy.twin.demonstrator import Demonstrator
from bt_jax.deploy.twin.person_hand import HandModel
from bt_jax.deploy.twin.rendered_camera import CameraPlacement, RenderedCamera

__all__ = ["FilmedDemonstration", "Light"]

HAND = "scene/hand"


@dataclasses.dataclass(frozen=True)
class Light:
    """Brightness of the light from everywhere and of the lamps, as shares of what the scene has, and the direction in which
    the first lamp shines, None for its own."""

    ambient: float = 1.0
    lamps: float = 1.0
    direction: tuple[float, float, float] | None = None


class FilmedDemonstration:
    """Film a demonstrator at `fps` images a second of its own time; FilmEnded follows the last image. `placement` is another
    place for the camera, in the world; what our side believes of it is the caller's to say."""

    def __init__(
        self,
        scene: TwinScene,
        demonstrator: Demonstrator,
        *,
        fps: float,
        hand: HandModel | None = None,
        light: Light | None = None,
        placement: CameraPlacement | None = None,
        seed: int | list[int] = 0,
    ) -> None:
        self.demonstrator, self._step = demonstrator, 1 / fps
        size = max(box.edge for box in scene.task.objects)
        model = _model(scene, hand or HandModel(), size, light or Light(), placement)
        realism = dataclasses.replace(scene.realism, rate=float("inf"))
        self._camera = RenderedCamera(model, self._state, CAMERA, realism=realism, seed=seed)

    def read(self) -> CameraFrame:
        """Return the next image. Raise FilmEnded after the last."""
        if self.demonstrator.done:
            raise FilmEnded("the demonstration is at its end")
        self.demonstrator.advance(self._step)
        return self._camera.read()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._camera.close()

    def _state(self) -> tuple[float, Float[np.ndarray, " nq"]]:
        person = self.demonstrator
        hand = person.hand
        place = [*hand.translation, *hand.rotation.as_quat(scalar_first=True)]
        return person.time, np.concatenate([person.qpos, place])


def _model(
    scene: TwinScene, hand: HandModel, size: float, light: Light, placement: CameraPlacement | None
) -> mujoco.MjModel:
    """Return the scene's model with the hand, which comes last in qpos."""
    root = ET.fromstring(scene.cell.xml)
    world, headlight = root.find("worldbody"), root.find("visual/headlight")
    assert world is not None
    assert headlight is not None
    world.append(ET.fromstring(hand.mjcf(HAND, size)))
    for element, share in ((headlight, light.ambient), *((lamp, light.lamps) for lamp in world.findall("light"))):
        for key in ("ambient", "diffuse", "specular"):
            if key in element.attrib:
                element.set(
                    key, " ".join(f"{min(1.0, share * float(part)):.4g}" for part in element.get(key, "").split())
                )
    lamp = world.find("light")
    if light.direction is not None and lamp is not None:
        lamp.set("dir", " ".join(map(str, light.direction)))
    if placement is not None:
        for camera in world.findall(f"camera[@name='{CAMERA}']"):
            world.remove(camera)
        world.append(ET.fromstring(placement.mjcf(CAMERA)))
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"), dict(scene.cell.assets))
