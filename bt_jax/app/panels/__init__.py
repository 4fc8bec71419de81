"""The seven steps: each module builds one panel of the page with `build(studio, page)`."""

from bt_jax.app.panels import combine, demonstrate, evolve, keep, run, task, understand

__all__ = ["PANELS"]

PANELS = {
    "task": task.build,
    "evolve": evolve.build,
    "demonstrate": demonstrate.build,
    "understand": understand.build,
    "combine": combine.build,
    "run": run.build,
    "keep": keep.build,
}
