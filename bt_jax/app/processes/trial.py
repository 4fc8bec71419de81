"""How often a learnt tree works: `bt_jax.learn` as a process of its own, which also keeps all that was learnt."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from datetime import datetime
from pathlib import Path

from bt_jax._util.files import unused, write_atomic
from bt_jax._util.yaml_files import to_yaml
from bt_jax.app.processes.subprocess import run_command
from bt_jax.tasks import Task

__all__ = ["LAYOUTS", "Trial", "try_out"]

LAYOUTS = 20


@dataclasses.dataclass(frozen=True)
class Trial:
    """A tree has reached what was demonstrated in `solved` of `tried` random layouts; it is kept in the run folder
    `folder`."""

    solved: int
    tried: int
    folder: str

    @property
    def sentence(self) -> str:
        """The result, and what to do next."""
        said = f"It reaches what was demonstrated from {self.solved} of {self.tried} random starts."
        if self.solved < self.tried:
            said += (
                " Demonstrations that begin where a tree has ended show only the last step: let evolution find the rest, "
                "in step 5."
            )
        return said


async def try_out(demonstrations: Path, task: Task, runs: Path, *, layouts: int = LAYOUTS) -> Trial:
    """Learn from a folder of demonstrations and run the tree in random layouts of a task; the results go to a new folder in
    `runs`. Raise UserError if that fails."""
    out = unused(runs / f"learn-{demonstrations.name.replace(' ', '-')}-{datetime.now():%Y%m%d-%H%M%S}")
    with tempfile.TemporaryDirectory(prefix="bt_jax-") as scratch:
        source = Path(scratch) / f"{task.name}.yaml"
        write_atomic(source, to_yaml(task.to_dict()))
        words = [str(demonstrations), "--task", str(source), "--out", str(out), "--layouts", str(layouts)]
        await run_command("bt_jax.learn", words, otherwise="the trial was stopped; try again")
    found = json.loads((out / "lesson.json").read_text(encoding="utf-8"))
    return Trial(found["solved"], found["tried"], out.name)
