"""The tree that is looked at, run in real time: play, pause, single ticks, speed, and objects that a person moves."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import traceback
from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.edited_task import EditedTask
from bt_jax.app.state.player import Player
from bt_jax.app.state.worker import Worker
from bt_jax.behaviors import Tree
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.render.choreography import Shot
from bt_jax.mjx_env.world import World

__all__ = ["SPEEDS", "Cue", "Playing"]

SPEEDS = (0.5, 1.0, 2.0, 4.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Cue:
    """What the scene of every window does now: show the last shot, play them in `seconds`, hold still, or go on."""

    kind: Literal["show", "play", "freeze", "go on"]
    shots: tuple[Shot, ...]
    seconds: float = 0.0


class Playing:
    """`tree` is the tree to look at and to run, `run` the name of the run folder that it comes from, None if it comes from
    none, and `player` runs it. Changes are announced under the topic "player"; `cue` is then what to do.

    Motions take their time in the browsers; here only their ends are known.
    """

    def __init__(self, bus: Bus, worker: Worker, edited: EditedTask) -> None:
        self.tree: Tree | None = None
        self.run: str | None = None
        self.player: Player | None = None
        self.speed = 1.0
        self.cue: Cue | None = None
        self.on = False  # goes on by itself
        self._bus, self._worker, self._edited = bus, worker, edited
        self._lasting = False  # and did so until the episode ended
        self._ends = 0.0  # when the motion that is shown ends, by the clock of the loop
        self._left: float | None = None  # seconds of it that are left while it is held
        self._stop = asyncio.Event()
        self._task: asyncio.Task | None = None
        self._turn = asyncio.Lock()

    def take(self, tree: Tree | None, run: str | None) -> None:
        """Take another tree, with its run; whatever runs ends."""
        self.halt()
        self.tree, self.run, self.player = tree, run, None

    def follow(self, tree: Tree | None, run: str | None) -> None:
        """Take the best tree of a run that is evolving; whatever runs goes on."""
        self.tree, self.run = tree, run

    def clear(self) -> None:
        """End whatever runs: the scene has changed."""
        self.player = None

    def forget_run(self, name: str) -> None:
        """Keep the tree of a run that was deleted, without its run."""
        if self.run == name:
            self.run = None

    async def begin(self, start: World | None = None, fate: Fates | None = None, *, again: bool = True) -> None:
        """Begin an episode of the tree, with what goes wrong in it; unless `again`, only if none has begun. Raise UserError
        if there is no tree, or it does not fit the task."""
        if self.tree is None:
            raise UserError("there is no tree to run yet; evolve one, or choose a run")
        if again:
            self.halt()
        async with self._turn:
            if not again and self.player is not None:
                return
            world, task, tree = self._edited.start if start is None else start, self._edited.task, self.tree
            player = await self._worker.work(Player, task, self._worker.physics(task), tree, world, fate)
            if self._edited.task is not task:
                return  # nobody waits for this any more
            going = self.on  # somebody has pressed Play meanwhile
            self.halt()
            self.player = player
            self._show(player, moving=False)
        if going:
            self.play()

    def set_speed(self, speed: float) -> None:
        """Set how fast motions are shown; 1 is normal."""
        self.speed = speed

    def play(self) -> None:
        """Go on until the episode ends; if it has ended, from its beginning."""
        player = self._player()
        if self.on:
            return
        if player.at == len(player.snapshots) - 1 and player.ending != Ending.OPEN:
            player.seek(0)
            self._show(player, moving=False)
        self.on = self._lasting = True
        self._stop = asyncio.Event()
        if self._left is not None:
            self._ends, self._left = self._now() + self._left, None
            self.cue = Cue("go on", ())
        self._task = asyncio.get_running_loop().create_task(self._go_on(player, self._stop))
        self._bus.changed("player")

    def pause(self) -> None:
        """Hold everything still, in mid-motion if need be."""
        if not self.on:
            return
        self.halt()
        left = self._ends - self._now()
        if left > 0:
            self._left, self.cue = left, Cue("freeze", ())
        self._bus.changed("player")

    def halt(self) -> None:
        """Stop going on."""
        self.on = self._lasting = False
        self._left = None
        self._stop.set()

    async def tick(self) -> None:
        """Go one tick on, then pause."""
        self.halt()
        async with self._turn:
            player = self._player()
            before = player.at
            await self._worker.work(player.tick)
            self._show(player, moving=player.at != before)

    async def seek(self, at: int) -> None:
        """Pause and show another snapshot."""
        self.halt()
        async with self._turn:
            player = self._player()
            player.seek(at)
            self._show(player, moving=False)

    async def put(self, name: str, place: Callable[[World], Float[np.ndarray, "3"]], turn: float | None = None) -> None:
        """Move an object, once the motion that is shown has ended, to its `place` [m, world] in the scene as it is then,
        turned by `turn` degrees or else as it lies, and go on as before. Raise UserError, and change nothing, if the object
        cannot be put there."""
        async with self._turn:
            player = self._player()
            if self._left is None:
                await asyncio.sleep(max(0.0, self._ends - self._now()))
            await self._worker.work(player.put, name, place(player.world), turn)
            self._left = None
            self._show(player, moving=False)
        if self._lasting and not self.on:
            self.play()

    def _player(self) -> Player:
        if self.player is None:
            raise UserError("nothing runs; choose a tree first")
        return self.player

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def _show(self, player: Player, *, moving: bool) -> None:
        """Announce the snapshot of a player, unless another has taken its place meanwhile."""
        if player is not self.player:
            return
        now = player.now
        moving = moving and len(now.shots) > 1
        seconds = now.seconds / self.speed
        self._ends = self._now() + (seconds if self.on or moving else 0.0)
        self.cue = Cue("play", now.shots, seconds) if moving else Cue("show", now.shots[-1:])
        self._bus.changed("player")

    async def _go_on(self, player: Player, stop: asyncio.Event) -> None:
        try:
            while not await self._stopped(stop) and player is self.player:
                async with self._turn:
                    if stop.is_set() or self._ends > self._now():
                        continue
                    if player.at == len(player.snapshots) - 1 and player.ending != Ending.OPEN:
                        break
                    await self._worker.work(player.tick)
                    self._show(player, moving=not stop.is_set())
        except Exception as error:
            traceback.print_exc()
            self._bus.say(f"The tree could not go on ({error}); press Start over.", "error")
        if not stop.is_set():
            self.on = False
            self._bus.changed("player")

    async def _stopped(self, stop: asyncio.Event) -> bool:
        """Wait until the motion that is shown has ended; return whether it was told to stop meanwhile."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, self._ends - self._now()))
        return stop.is_set()
