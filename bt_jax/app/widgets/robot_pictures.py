"""What the robot's camera sees and the whole cell, in place of the scene while the step `robot` is shown.

The pictures come over HTTP, each as soon as the browser has the one before: a slow connection gets fewer.
"""

from __future__ import annotations

from nicegui import ui
from nicegui.events import MouseEventArguments

from bt_jax.app.processes.twin_messages import CAMERA_SIZE, Person
from bt_jax.app.state.robot_twin import RobotTwin
from bt_jax.app.widgets.context import PageContext, Step
from bt_jax.app.widgets.scene_view import SceneView

__all__ = ["RobotPictures"]

NAMES = {"camera": "What the robot's camera sees", "cell": "The robot"}


class RobotPictures:
    """Built into the container that is open. A person drags an object in the camera's picture to another place, or off the
    tables; a click pushes it."""

    def __init__(self, robot: RobotTwin, page: PageContext, scene: SceneView) -> None:
        self._robot, self._page, self._scene = robot, page, scene
        self._shown: dict[str, int] = {}
        self._from: tuple[float, float] | None = None
        with ui.element("div").classes("robot-pictures").props("data-testid=robot-pictures") as self._area:
            self._nothing = ui.label("Here you will see what the robot sees, and the robot.").classes("robot-nothing")
            self._images = {name: self._image(name) for name in NAMES}
        page.on("robot", self._refresh)
        page.on_step(self._enter)

    def _image(self, name: str) -> ui.interactive_image:
        with ui.element("figure").classes("robot-figure"):
            image = ui.interactive_image(
                events=["mousedown", "mouseup"], on_mouse=self._page.guard(self._mouse), sanitize=False
            )
            image.props(f'data-testid=robot-{name} role=img aria-label="{NAMES[name]}"')
            image.classes(f"robot-{name}")
            with ui.element("figcaption"):
                ui.label(NAMES[name])
        return image

    def _enter(self, step: Step) -> None:
        self._scene.set_visibility(step != "robot")
        self._area.set_visibility(step == "robot")
        self._refresh()

    def _refresh(self) -> None:
        if self._page.step != "robot":
            return
        pictures = self._robot.pictures
        self._nothing.set_visibility(not pictures)
        for name, image in self._images.items():
            figure = image.parent_slot.parent if image.parent_slot is not None else image
            figure.set_visibility(name in pictures)
            number = self._robot.numbers.get(name, 0)
            if name in pictures and self._shown.get(name) != number:
                self._shown[name] = number
                image.set_source(f"/robot/{name}.jpg?n={number}")

    def _mouse(self, event: MouseEventArguments) -> None:
        """Begin a drag in the camera's picture, or end it."""
        if event.sender is not self._images["camera"] or not self._robot.running:
            return
        place = (event.image_x / CAMERA_SIZE[0], event.image_y / CAMERA_SIZE[1])
        if event.type == "mousedown":
            self._from = place
        elif self._from is not None:
            start, self._from = self._from, None
            self._robot.disturb(Person("carry", start=start, end=place))
