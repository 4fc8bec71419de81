"""A tree that runs in the scene while a person watches, steps back and forth, and moves objects."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from bt_jax.app.state.arrangement import put
from bt_jax.behaviors import Tree, Vocabulary, expand
from bt_jax.encoding.drawing.svg import node_ids
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.episodes.playback import EpisodeState, Tick
from bt_jax.mjx_env.episodes.rules import Ending, fresh_tally
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.choreography import Shot, Stage
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["FPS", "Player", "Snapshot"]

FPS = 20.0  # of the motion between snapshots; the browser interpolates
IDLE_SECONDS = 0.8  # of a tick in which nothing moves
AT_HOME = 1e-3  # metres


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """The scene between two ticks, and what led to it: a `tick`, or the name of the object that a person `moved` after that
    tick. The last of the `shots` is how the scene looks now, those before it are the motion of the tick."""

    episode: EpisodeState
    tick: Tick | None
    moved: str | None
    shots: tuple[Shot, ...]

    @property
    def seconds(self) -> float:
        """Return how long the motion that led here takes at normal speed."""
        return max((len(self.shots) - 1) / FPS, IDLE_SECONDS)


class Player:
    """An episode that is watched: its `snapshots` up to now, of which number `at` is shown.

    Genes run as the subtrees that they stand for, so that these can be watched, too.
    """

    def __init__(self, task: Task, physics: Physics, tree: Tree, start: World, fate: Fates | None = None) -> None:
        """Begin in `start`, a batch of one state (NumPy), with a `fate`, a batch of one, if things go wrong. Raise UserError
        if the tree does not fit the task."""
        self.task, self.tree, self.physics, self.fate = task, tree, physics, fate
        self._semantics = LeafSemantics(task, Vocabulary.of(leaves(expand(tree))))
        self._settler = Settler(task, physics)
        self._ids = node_ids(tree)
        stage = Stage(self._semantics, start, fps=FPS)
        self.snapshots = [Snapshot(self._episode(start), None, None, (stage.shots[-1],))]
        self.at = 0

    @property
    def now(self) -> Snapshot:
        """The snapshot that is shown."""
        return self.snapshots[self.at]

    @property
    def world(self) -> World:
        """The scene that is shown, a batch of one state."""
        return self.now.episode.world

    @property
    def ending(self) -> Ending:
        """How the episode has ended by then; OPEN if it goes on."""
        return self.now.episode.ending

    @property
    def statuses(self) -> dict[str, Status | None]:
        """What the nodes returned in the last tick, by their ids in the drawing (`encoding.drawing.svg`)."""
        if self.now.tick is None:
            return dict.fromkeys(self._ids)
        return dict(zip(self._ids, self.now.tick.statuses, strict=True))

    @property
    def in_place(self) -> tuple[bool, ...]:
        """Whether each target is met."""
        return tuple(target_misses(self.task, self.world).met[0].tolist())

    def tick(self) -> Snapshot:
        """Go one tick on, through the recorded snapshots first. At the end, do nothing."""
        if self.at + 1 < len(self.snapshots):
            self.at += 1
        elif self.ending == Ending.OPEN:
            tick, episode = self.now.episode.tick()
            self.snapshots.append(Snapshot(episode, tick, None, self._motion(tick, episode)))
            self.at += 1
        return self.now

    def seek(self, at: int) -> Snapshot:
        """Show the snapshot of this number, or the closest."""
        self.at = min(max(at, 0), len(self.snapshots) - 1)
        return self.now

    def put(self, name: str, position: Float[np.ndarray, "3"], turn: float | None = None) -> Snapshot:
        """Move an object (metres, world; degrees) in the snapshot that is shown; later ones are dropped, and the tree has
        all its ticks again. Raise UserError, and change nothing, as `arrangement.put` does."""
        world = put(self.task, self.physics, self.world, name, position, turn)
        del self.snapshots[self.at + 1 :]
        shot = dataclasses.replace(self.now.shots[-1], poses=np.asarray(world.poses[0], float))
        self.snapshots.append(Snapshot(self._episode(world), self.now.tick, name, (shot,)))
        self.at += 1
        return self.now

    def _episode(self, world: World) -> EpisodeState:
        tally = fresh_tally(1, has_faults=self.fate is not None)
        return EpisodeState(self._semantics, self._settler, expand(self.tree), world, tally, fate=self.fate)

    def _motion(self, tick: Tick, after: EpisodeState) -> tuple[Shot, ...]:
        """Return the motion of gripper and objects; the tick that would follow tells where an object will be put."""
        stage = Stage(self._semantics, tick.before, fps=FPS, gripper=self.now.shots[-1].gripper)
        stage.run(tick, [after.tick()[0]] if after.ending == Ending.OPEN else [])
        if tick.command is None and np.linalg.norm(stage.tip - stage.home) > AT_HOME:
            stage.leave()
        if after.world is not tick.after:  # a person or a fault has moved something since
            stage.shots.append(dataclasses.replace(stage.shots[-1], poses=np.asarray(after.world.poses[0], float)))
        return tuple(stage.shots)
