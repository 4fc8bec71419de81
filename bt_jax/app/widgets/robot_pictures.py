"""What the robot's camera sees and the whole cell, in place of the scene while the step `robot` is shown."""

from __future__ import annotations

from nicegui import ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from bt_jax.app.processes.twin_messages import Person
from bt_jax.app.state.robot_twin import RobotTwin
from bt_jax.app.widgets.context import PageContext, Step
from bt_jax.app.widgets.scene_view import SceneView

__all__ = ["RobotPictures"]

NAMES = {"camera": "What the robot's camera sees", "cell": "The robot"}


class _Picture(Element, component="../static/robot_picture.js"):
    """A picture of the server by its name."""

    def __init__(self, name: str, alt: str) -> None:
        super().__init__()
        self._name, self._number = name, 0
        self._props.update(src="", alt=alt, drags=False)

    def show(self, number: int, *, drags: bool) -> None:
        """Show the picture of that number, and let a person drag on it or not."""
        if (number, drags) != (self._number, self._props["drags"]):
            self._number = number
            self._props.update(src=f"/robot/{self._name}.jpg?n={number}", drags=drags)
            self.update()


class RobotPictures:
    """Built into the container that is open. A person drags an object in the camera's picture to another place, or off the
    tables; a click pushes it."""

    def __init__(self, robot: RobotTwin, page: PageContext, scene: SceneView) -> None:
        self._robot, self._page, self._scene = robot, page, scene
        with ui.element("div").classes("robot-pictures").props("data-testid=robot-pictures") as self._area:
            self._nothing = ui.label("Here you will see what the robot sees, and the robot.").classes("robot-nothing")
            self._pictures = {name: self._picture(name, title) for name, title in NAMES.items()}
        page.on("robot", self._refresh)
        page.on_step(self._enter)

    def _picture(self, name: str, title: str) -> tuple[ui.element, _Picture]:
        with ui.element("figure").classes("robot-figure") as figure:
            picture = _Picture(name, title).classes(f"robot-{name}").props(f"data-testid=robot-{name}")
            with ui.element("figcaption"):
                ui.label(title)
        picture.on("drag", self._page.guard(self._drag))
        return figure, picture

    def _enter(self, step: Step) -> None:
        self._scene.set_visibility(step != "robot")
        self._area.set_visibility(step == "robot")
        self._refresh()

    def _refresh(self) -> None:
        if self._page.step != "robot":
            return
        robot = self._robot
        self._nothing.set_visibility(not robot.pictures)
        for name, (figure, picture) in self._pictures.items():
            figure.set_visibility(name in robot.pictures)
            if name in robot.pictures:
                picture.show(robot.numbers[name], drags=name == "camera" and robot.stage == "running")

    def _drag(self, event: GenericEventArguments) -> None:
        (start, end) = (tuple(map(float, event.args[key])) for key in ("start", "end"))
        self._robot.disturb(Person("carry", start=(start[0], start[1]), end=(end[0], end[1])))
