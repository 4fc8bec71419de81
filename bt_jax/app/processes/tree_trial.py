"""How often a tree works, tried by a process of its own while a person goes on editing.

The process, python -m bt_jax.app.processes.tree_trial, answers each line of JSON on stdin, {task, tree, first, last}, by one
on stdout, {solved, reasons}: of the episodes from `first` to `last`, how many the tree solves, and why it fails in the
others. It ends when stdin does.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import os
import sys
from collections import Counter
from collections.abc import AsyncGenerator
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.app.processes.subprocess import NICE
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import one_line
from bt_jax.tasks import Task

__all__ = ["STARTS", "TreeTrial", "Tried", "main"]

STARTS = 100
AT_ONCE = 10
LIMIT = 1 << 24  # bytes of a line


@dataclasses.dataclass(frozen=True)
class Tried:
    """A tree works in `solved` of the `tried` starts so far; `reasons` says why it fails, the commonest first."""

    solved: int
    tried: int
    reasons: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The result, as far as it is known."""
        if self.tried < STARTS:
            return f"works in {self.solved} of {self.tried} so far"
        return f"works in {self.solved} of {self.tried}"


class TreeTrial:
    """The page's side; the process begins with the first trial."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()

    async def tried(self, task: Task, tree: Tree) -> AsyncGenerator[Tried]:
        """Try a tree in more and more starts, up to STARTS, and yield what is known; whoever does not want to know more
        closes the iterator. Raise UserError if the process fails."""
        solved, reasons = 0, Counter[str]()
        for first in range(0, STARTS, AT_ONCE):
            request = {"task": task.to_dict(), "tree": one_line(tree), "first": first, "last": first + AT_ONCE}
            # An answer belongs to its request, also if nobody waits for it any more.
            answer = await asyncio.shield(asyncio.ensure_future(self._asked(request)))
            solved += answer["solved"]
            reasons.update(answer["reasons"])
            commonest = tuple(f"{reason} ({counted(count, 'time')})" for reason, count in reasons.most_common(3))
            yield Tried(solved, first + AT_ONCE, commonest)

    async def _asked(self, request: dict[str, Any]) -> dict[str, Any]:
        line = b""
        async with self._turn:
            with contextlib.suppress(OSError):
                process = self._process = self._process or await _started()
                assert process.stdin is not None
                assert process.stdout is not None
                process.stdin.write(json.dumps(request).encode() + b"\n")
                await process.stdin.drain()
                line = await process.stdout.readline()
        if not line:
            self.close()
            raise UserError("the tree could not be tried; change something, and it is tried again")
        return json.loads(line)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        self._process = None


async def _started() -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bt_jax.app.processes.tree_trial"),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        limit=LIMIT,
        env={"XLA_PYTHON_CLIENT_PREALLOCATE": "false", **os.environ},
    )


def main() -> None:
    """The process's side."""
    # Imported here: the page imports this module and shall not wait for JAX.
    from bt_jax._util.startup import configure_jax
    from bt_jax.behaviors import Vocabulary
    from bt_jax.encoding.formats.text import parse_tree
    from bt_jax.encoding.walk import leaves
    from bt_jax.mjx_env.episodes.diagnosis import explain_failure
    from bt_jax.mjx_env.episodes.playback import play
    from bt_jax.mjx_env.faults.fates import sample_episodes
    from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
    from bt_jax.mjx_env.physics.settler import Settler
    from bt_jax.mjx_env.semantics import LeafSemantics
    from bt_jax.mjx_env.world import take
    from bt_jax.tasks import task_from_dict
    from bt_jax.training.settings import UNSEEN

    os.nice(NICE)
    configure_jax()
    for line in sys.stdin:
        request = json.loads(line)
        task, tree = task_from_dict(request["task"], source="the task", kept=True), parse_tree(request["tree"])
        layouts, fates = sample_episodes(task, [UNSEEN, 0], layouts=STARTS, draws=1)
        semantics, settler = (
            LeafSemantics(task, Vocabulary.of(leaves(tree))),
            Settler(task, MujocoPhysics(task, threads=1)),
        )
        solved, reasons = 0, Counter[str]()
        for k in range(request["first"], request["last"]):
            row = slice(k, k + 1)
            playback = play(semantics, settler, tree, take(layouts, row), None if fates is None else fates[row])
            solved += playback.solved
            if not playback.solved:
                reasons[explain_failure(task, playback)] += 1
        print(json.dumps({"solved": solved, "reasons": reasons}), flush=True)


if __name__ == "__main__":
    main()
