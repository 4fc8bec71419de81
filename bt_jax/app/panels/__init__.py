"""The eight steps: each module builds one panel of the page with `build(studio, page)`."""

from collections.abc import Callable

from bt_jax.app.panels import combine, demonstrate, evolve, keep, robot, run, task, understand
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import Step

__all__ = ["PANELS"]

PANELS: dict[Step, Callable[[Studio, PanelContext], None]] = {
    "task": task.build,
    "evolve": evolve.build,
    "demonstrate": demonstrate.build,
    "understand": understand.build,
    "combine": combine.build,
    "run": run.build,
    "robot": robot.build,
    "keep": keep.build,
}
