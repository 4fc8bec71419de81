"""The studio's player in real time: play, pause, single ticks, speed, and boxes that are moved meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.app.state.player import Player
from bt_jax.mjx_env.episodes.fitness import Ending
from bt_jax.mjx_env.render.choreography import Shot
from bt_jax.mjx_env.world import World

if TYPE_CHECKING:
    from bt_jax.app.state.studio import Studio

__all__ = ["SPEEDS", "Cue", "Playing"]

SPEEDS = (0.5, 1.0, 2.0, 4.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Cue:
    """What the scene of every window does now: show the last shot, play them in `seconds`, hold still, or go on."""

    kind: Literal["show", "play", "freeze", "go on"]
    shots: tuple[Shot, ...]
    seconds: float = 0.0


class Playing:
    """Lets the player go on by itself. Each change is told with the studio's topic "player"; `cue` is then what to do.

    Motions take their time in the browsers; here it is only known when they end.
    """

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.speed = 1.0
        self.cue: Cue | None = None
        self.on = False  # goes on by itself
        self._lasting = False  # and did so until the episode ended
        self._ends = 0.0  # when the motion that is shown ends, by the clock of the loop
        self._left: float | None = None  # how much of it is left where it is held
        self._stop = asyncio.Event()
        self._run: asyncio.Task | None = None
        self._turn = asyncio.Lock()

    async def begin(self, start: World | None = None, *, anew: bool = True) -> None:
        """An episode of the studio's tree; with `anew` also where there is one already. Raises UserError where there is no
        tree, or it is one of another task."""
        studio = self.studio
        if studio.tree is None:
            raise UserError("there is no tree to run yet; evolve one, or choose a run")
        if anew:
            self.halt()
        async with self._turn:
            if not anew and studio.player is not None:
                return
            world, task, tree = studio.start if start is None else start, studio.task, studio.tree
            player = await studio.work(Player, task, studio.physics, tree, world)
            if studio.task is not task:
                return  # nobody waits for this any more
            going = self.on  # somebody has pressed Play meanwhile
            self.halt()
            studio.player = player
            self._show(player, moving=False)
        if going:
            self.play()

    def play(self) -> None:
        """Goes on until the episode ends; from its beginning where it has ended."""
        player = self._player()
        if self.on:
            return
        if player.at == len(player.moments) - 1 and player.ending != Ending.OPEN:
            player.seek(0)
            self._show(player, moving=False)
        self.on = self._lasting = True
        self._stop = asyncio.Event()
        if self._left is not None:
            self._ends, self._left = self._now() + self._left, None
            self.cue = Cue("go on", ())
        self._run = asyncio.get_running_loop().create_task(self._go_on(player, self._stop))
        self.studio.changed("player")

    def pause(self) -> None:
        """Holds everything still, in mid-motion if need be."""
        if not self.on:
            return
        self.halt()
        left = self._ends - self._now()
        if left > 0:
            self._left, self.cue = left, Cue("freeze", ())
        self.studio.changed("player")

    def halt(self) -> None:
        """Goes on no more by itself."""
        self.on = self._lasting = False
        self._left = None
        self._stop.set()

    async def tick(self) -> None:
        """One tick, then a pause."""
        self.halt()
        async with self._turn:
            player = self._player()
            before = player.at
            await self.studio.work(player.tick)
            self._show(player, moving=player.at != before)

    async def seek(self, at: int) -> None:
        """Pauses and shows another moment."""
        self.halt()
        async with self._turn:
            player = self._player()
            player.seek(at)
            self._show(player, moving=False)

    async def put(self, name: str, place: Callable[[World], Float[np.ndarray, "3"]]) -> None:
        """A person moves a box, once the motion that is shown has ended, to its `place` [m, world] in what there is then;
        after that things go on as before. Raises UserError, and changes nothing, where that cannot be."""
        async with self._turn:
            player = self._player()
            if self._left is None:
                await asyncio.sleep(max(0.0, self._ends - self._now()))
            await self.studio.work(player.put, name, place(player.world))
            self._left = None
            self._show(player, moving=False)
        if self._lasting and not self.on:
            self.play()

    def _player(self) -> Player:
        if self.studio.player is None:
            raise UserError("nothing runs; choose a tree first")
        return self.studio.player

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def _show(self, player: Player, *, moving: bool) -> None:
        """Tells of the moment that a player is in, unless another has taken its place meanwhile."""
        if player is not self.studio.player:
            return
        moment = player.now
        moving = moving and len(moment.shots) > 1
        seconds = moment.seconds / self.speed
        self._ends = self._now() + (seconds if self.on or moving else 0.0)
        self.cue = Cue("play", moment.shots, seconds) if moving else Cue("show", moment.shots[-1:])
        self.studio.changed("player")

    async def _go_on(self, player: Player, stop: asyncio.Event) -> None:
        try:
            while not await self._stopped(stop) and player is self.studio.player:
                async with self._turn:
                    if stop.is_set() or self._ends > self._now():
                        continue
                    if player.at == len(player.moments) - 1 and player.ending != Ending.OPEN:
                        break
                    await self.studio.work(player.tick)
                    self._show(player, moving=not stop.is_set())
        except Exception as error:
            traceback.print_exc()
            self.studio.say(f"the tree could not go on ({error}); start it anew")
        if not stop.is_set():
            self.on = False
            self.studio.changed("player")

    async def _stopped(self, stop: asyncio.Event) -> bool:
        """Waits until the motion that is shown has ended; True where it was told to stop meanwhile."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, self._ends - self._now()))
        return stop.is_set()
