"""The bar over every step while the robot's twin runs: what it does, and the button that stops it."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.plain_words import Words
from bt_jax.app.state.robot_twin import RobotTwin
from bt_jax.app.state.robot_words import doing
from bt_jax.app.widgets.context import PageContext

__all__ = ["RobotBar"]


class RobotBar:
    """Built into the container that is open."""

    def __init__(self, robot: RobotTwin, page: PageContext) -> None:
        self._robot = robot
        with ui.element("div").classes("robot-bar").props("data-testid=robot-bar") as self._area:
            self._stop = ui.button("Stop", icon="front_hand", on_click=page.guard(robot.stop))
            self._stop.props("no-caps unelevated color=negative data-testid=robot-stop").classes("robot-stop")
            self._text = ui.label().classes("notice-text").props("data-testid=robot-bar-text")
        page.on("robot", self._refresh)

    def _refresh(self) -> None:
        robot = self._robot
        self._area.set_visibility(robot.running)
        if not robot.running or robot.run is None:
            return
        self._stop.set_enabled(robot.stage != "stopping")
        if robot.stage == "starting":
            self._text.set_text("The robot's twin is getting ready; this takes some seconds.")
        elif robot.stage == "stopping":
            self._text.set_text("Stopping: the arms slow down.")
        elif robot.tick is not None:
            self._text.set_text(f"The robot's twin: {doing(Words(robot.run.task), robot.tick)}.")
