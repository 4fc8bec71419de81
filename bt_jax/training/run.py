"""One run in its folder: it owns state, history and checkpoints, and says what happens when somebody presses Ctrl-C."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, runtime_checkable

from bt_jax._util.errors import UserError
from bt_jax._util.startup import CompileClock
from bt_jax.behaviors import Tree
from bt_jax.gp.evolution import Generation, State
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.interruption import Interruption
from bt_jax.training.pictures import draw_pictures
from bt_jax.training.progress import Stage, locked
from bt_jax.training.result import Result, Session
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder, not_of_one_run
from bt_jax.training.training import Training

__all__ = ["Listener", "TrainingRun"]

CHECKPOINT_SECONDS = 2.0
CHECKPOINT_SHARE = 20  # of the time goes into checkpoints: at most one part in so many


@runtime_checkable
class Listener(Protocol):
    """Whoever shows how a run goes. It only listens: if it raises an error, the run goes on without it."""

    def on_stage(self, stage: Stage, message: str = "") -> None:
        """Hear that another part of the work begins, or that the last has ended; `message` says why it has failed."""
        ...

    def on_generation(self, history: Sequence[Generation], best_tree: Callable[[], Tree]) -> None:
        """Hear that a generation was measured, the last of the `history`. The last one before an interruption may be told
        twice."""
        ...


class TrainingRun:
    """A run, new or `resumed`, bound to its folder.

    run = TrainingRun(folder, config)
    with run.opened(listener):
        result, session = run.evolve()
        run.draw(result)
    """

    def __init__(self, folder: RunFolder, config: RunConfig, *, resumed: bool = False) -> None:
        self.folder, self.resumed = folder, resumed
        self.training = Training.of(config)
        self.config = self.training.run_config
        if resumed:
            self._saved()
        self.unwritten = ""  # why not everything is in the folder, empty if it is
        self._stopped = self._written = self._warned = False
        self._measured = 0  # generations of this process
        self._checkpoint: Checkpoint | None = None  # the last complete generation of this process
        self._listeners: tuple[Listener, ...] = ()
        self._interruption = Interruption()

    @contextlib.contextmanager
    def opened(self, *listeners: Listener) -> Iterator[None]:
        """Claim the folder, and tell the listeners, in their order, all that happens. Raise UserError if the folder is not
        empty or another process trains in it."""
        if not self.resumed:
            self.folder.start(self.config)
        self._listeners = listeners
        with locked(self.folder.path), self._interruption:
            try:
                self._stage("starting")
                if self.resumed:
                    self.folder.begin_again(self.config)
                yield
                self._interruption.ignore()
            except BaseException as error:
                self._interruption.ignore()
                self._stage(*self._end(error))
                raise
            self._stage(*self._end())

    def evolve(self, *, target: float | None = None, time_limit: float | None = None) -> tuple[Result, Session]:
        """Evolve, test the best tree, write the folder but for the pictures, and return what was found and what it took.

        The evolution ends at its last generation, once every run has the `target` fitness, after `time_limit` seconds, or at
        Ctrl-C. Even then the tree is tested and everything written, unless a second Ctrl-C ends the test. A full disk ends
        nothing: `unwritten` says why something is missing. Raise UserError if it was stopped before the first generation.
        """
        began = time.monotonic()
        with CompileClock() as clock:
            try:
                self._evolve(target, time_limit)
                self._interruption.ignore()
            except KeyboardInterrupt:  # from the first signal on, the next ones are ignored
                self._stopped = True
        if self._checkpoint is None:
            raise UserError("stopped before the first generation was measured; nothing was learnt")
        seconds, broken = time.monotonic() - began, self.training.num_broken
        session = Session(seconds, clock.seconds, broken, self._stopped, self._measured)
        self.unwritten = ""
        best = self.training.best_tree(self._checkpoint.state)
        self._write(lambda: self.folder.save_tree(best, title=self.config.task.name))
        self._save(self._checkpoint)
        if self._stopped:
            self._tell_generation()
        self._stage("testing")
        self._interruption.heed()
        if self._stopped:  # the interruption may have come in the middle of an entry into the table
            self.training = Training.of(self.config)
        result = self.training.result(self._checkpoint.state, self._checkpoint.history)
        self._write(lambda: result.write(self.folder, session))
        self._written = not self.unwritten
        return result, session

    def draw(self, result: Result) -> str:
        """Draw the pictures of the folder, unless something else could not be written; Ctrl-C waits for them. Return why one
        is missing, or an empty text."""
        if self.unwritten:
            return ""
        with self._interruption.ignored():
            try:
                settler = self.training.table.settler
                draw_pictures(self.folder, self.config, result.tree, result.history, settler)
            except Exception as error:  # whatever it is, everything else of the run is written
                return f"not all pictures could be drawn ({error}); the results are complete without them"
        return ""

    def _evolve(self, target: float | None, time_limit: float | None) -> None:
        start, history = self._restored()
        known = {row.generation for row in history}
        saved, wait = time.monotonic(), CHECKPOINT_SECONDS
        evolution, symbols = self.training.evolution, self.training.vocabulary.symbols
        for state in evolution.run(start, target=target, time_limit=time_limit):
            if state.generation not in known:
                history = [*history, *evolution.describe(state)]
                self._measured += 1
            if self._checkpoint is None:
                self._stage("evolving")
            self._checkpoint = Checkpoint(state, symbols, self.config.phase, history, self.config)
            if time.monotonic() - saved >= wait:
                began = time.monotonic()
                self._save(self._checkpoint)
                saved = time.monotonic()
                wait = max(CHECKPOINT_SECONDS, CHECKPOINT_SHARE * (saved - began))
            self._tell_generation()
            self._interruption.check()

    def _restored(self) -> tuple[State | None, list[Generation]]:
        """Return where to go on: at the checkpoint, measured again if it is of the phase before; at a new population if
        there is none."""
        saved = self._saved() if self.resumed else None
        if saved is None:
            return None, []
        if saved.phase == self.config.phase:
            return saved.state, saved.history
        return self.training.carried(saved.state, saved.symbols), saved.history

    def _saved(self) -> Checkpoint | None:
        """Return the checkpoint, None if there is none yet. Raise UserError if it is of another run, or its leaves are not
        those of this one."""
        saved, known = self.folder.load_checkpoint(), self.training.vocabulary.symbols
        if saved is None:
            return None
        if (other := next((leaf for leaf in saved.symbols if leaf not in known), None)) is not None:
            raise not_of_one_run(self.folder.path, f"only the checkpoint has the behavior {other}")
        if saved.phase == self.config.phase and saved.symbols != known:
            raise not_of_one_run(self.folder.path, "their behaviors are others, or in another order")
        return saved

    def _save(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint; if somebody has removed the folder meanwhile, make it again."""

        def save() -> None:
            if not (self.folder.path / "config.json").is_file():
                self.folder.save_config(self.config)
            self.folder.save_checkpoint(checkpoint)

        self._write(save)

    def _write(self, action: Callable[[], object]) -> None:
        """Write something; if that fails, say so once and go on, since what was evolved is still in memory."""
        try:
            action()
        except (UserError, OSError) as error:
            self.unwritten = str(error)
            if not self._warned:
                self._warned = True
                with contextlib.suppress(OSError):
                    print(f"warning: {error}; the evolution goes on without it", file=sys.stderr)

    def _end(self, error: BaseException | None = None) -> tuple[Stage, str]:
        """Return how the run has ended, and why it has failed; no error fails a run whose results are written."""
        if error is None or self._written:
            return ("stopped" if self._stopped else "finished"), ""
        if isinstance(error, KeyboardInterrupt):
            return "stopped", ""
        return "failed", str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"

    def _stage(self, stage: Stage, message: str = "") -> None:
        self._tell(lambda listener: listener.on_stage(stage, message))

    def _tell_generation(self) -> None:
        checkpoint = self._checkpoint
        assert checkpoint is not None
        self._tell(
            lambda listener: listener.on_generation(
                checkpoint.history, lambda: self.training.best_tree(checkpoint.state)
            )
        )

    def _tell(self, news: Callable[[Listener], None]) -> None:
        """Tell every listener, and from then on leave out one that raises."""
        for listener in self._listeners:
            try:
                news(listener)
            except (Exception, SystemExit) as error:  # Rich turns a broken pipe into SystemExit
                self._listeners = tuple(other for other in self._listeners if other is not listener)
                with contextlib.suppress(OSError):
                    print(f"warning: {type(listener).__name__} shows no more of the run ({error})", file=sys.stderr)
