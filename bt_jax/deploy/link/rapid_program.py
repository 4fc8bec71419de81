"""The RAPID program on the controller, as the link uses it: start and stop, guided motion on request, grippers.

All requests go over Robot Web Services, one at a time and within one budget, from whichever thread; only the stop has its
own way, see `program_stop`.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.program_stop import ProgramStop
from bt_jax.deploy.link.request_budget import RequestBudget
from bt_jax.deploy.link.rws import (
    EGM_HERE,
    EGM_REQUEST,
    EGM_STATE,
    GRIP_ACTUAL,
    GRIP_FORCE,
    GRIP_TARGET,
    ControllerMessage,
    ControllerState,
    Motion,
    Rws,
    symbol,
)
from bt_jax.deploy.link.settings import LinkConfig

__all__ = ["RapidProgram"]

MILLIMETRES = 500.0  # mm a finger for a metre between both
GRIPPING = 3.0  # seconds after a command in which only the gripper that was told to move is read
WARNING = 2  # kind of a message from which on it may be why the robot stopped


class RapidProgram:
    """The program in both arms' tasks. Every call raises UserError where the controller does not answer as it should.
    `realtime` False: time is simulated, and no budget limits the requests."""

    def __init__(self, config: LinkConfig, *, realtime: bool = True) -> None:
        self.arms = tuple(config.ports)
        self._grippers = config.grippers
        self.openings = dict.fromkeys(self.arms, math.nan)  # m between the fingers, as read last
        self._forces: dict[str, float] = {}  # N, as written last
        self._gripped: tuple[str, float] = ("", float("-inf"))  # arm that was told to grip last, and when
        self._turns = itertools.cycle(self.arms)
        self._told = 0  # number of the newest message before the start
        access = (config.host, config.rws_port, config.user, config.password)
        budget = RequestBudget() if realtime else RequestBudget(None)
        self._rws = Rws(*access, budget=budget)
        self._urgent = Rws(*access, timeout=config.timing.attempt, back_off=())  # of a stop, which waits for no budget
        self._stop = ProgramStop(self._urgent, config.timing.retry)

    @property
    def stopping(self) -> bool:
        """Was the program told to stop?"""
        return self._stop.begun

    def state(self) -> ControllerState:
        """Return the controller's state, asked for now."""
        return self._rws.state()

    def start(self, *, here: bool = False) -> None:
        """Start the program from its beginning; the arms stand still until they are asked to follow. They must be at their
        ready targets, unless they are to begin where they are `here`."""
        try:
            for arm in self.arms if here else ():
                self._rws.set_number(symbol(arm, EGM_HERE), 1.0)
            self._rws.start()
        except BaseException:
            self._begin_at_ready()
            raise

    def why_not_followed(self, problem: str) -> str:
        """Return why the arms do not follow after a start, a `problem` that our side sees, and what to do."""
        self._begin_at_ready()
        if self.state().rapid == "running":
            return f"{problem}; check that EGM is set up to send to this machine"
        said = self.complaint()
        return (
            f"{problem}: the robot's program has stopped{'' if said is None else f' ({said})'}; read on the pendant what "
            "BtJax says: each gripper must be calibrated, and each arm at its ready target, where PP to go_ready takes it"
        )

    def _begin_at_ready(self) -> None:
        """Have the next start, whoever it is by, require the ready targets, as far as the controller answers."""
        for arm in self.arms:
            with contextlib.suppress(UserError):
                self._rws.set_number(symbol(arm, EGM_HERE), 0.0)

    def expect_stop(self) -> None:
        """Make ready for a stop: open its session, and note what the controller's event log says by now."""
        self._stop.log_in()
        self._told = max((message.number for message in self._rws.messages()), default=0)

    def stop(self) -> None:
        """Begin to stop the program, again and again until it has; return at once. The robot brakes along its path."""
        self._stop.begin()

    def stopped(self, seconds: float) -> bool:
        """Wait until the controller confirms the stop; return whether it does."""
        return self._stop.wait(seconds)

    def messages(self) -> list[ControllerMessage]:
        """Return the last lines of the controller's event log, the newest first."""
        return self._rws.messages()

    def complaint(self) -> str | None:
        """Return the newest warning or error in the controller's event log since `expect_stop`, None if it has none."""
        new = [each for each in self._urgent.messages() if each.number > self._told and each.kind >= WARNING]
        return str(new[0]) if new else None

    def ask_to_follow(self) -> str | None:
        """Ask the arms that do not follow EGM yet to do so. Return which do not, None where all follow."""
        waiting = []
        for arm in self.arms:
            if self._rws.number(symbol(arm, EGM_STATE)) != Motion.GUIDED:
                self._rws.set_number(symbol(arm, EGM_REQUEST), float(Motion.GUIDED))
                waiting.append(arm)
        return f"{' and '.join(waiting)}: not guided" if waiting else None

    def end_guided_motion(self) -> None:
        """Have the program end guided motion itself, smoothly; the arms must still be held while it does."""
        for arm in self.arms:
            self._rws.set_number(symbol(arm, EGM_REQUEST), float(Motion.LISTEN))

    def grip(self, arm: str, opening: float, force: float) -> None:
        """Move an arm's fingers to a distance from each other [m], with a force [N], both clipped to what is possible."""
        gripper = self._grippers[arm]
        force = float(np.clip(force, 0, gripper.force))
        if self._forces.get(arm) != force:
            self._rws.set_number(symbol(arm, GRIP_FORCE), force)
            self._forces[arm] = force
        self._rws.set_number(symbol(arm, GRIP_TARGET), MILLIMETRES * float(np.clip(opening, 0, gripper.opening)))
        self._gripped = arm, time.monotonic()

    def read_openings(self) -> None:
        """Read how far apart the fingers of all arms are."""
        for arm in self.arms:
            self._read_opening(arm)

    def read_next_opening(self) -> None:
        """Read how far apart the fingers of one arm are: of that which was told to grip lately, else of each in turn."""
        arm, when = self._gripped
        self._read_opening(arm if time.monotonic() - when < GRIPPING else next(self._turns))

    def _read_opening(self, arm: str) -> None:
        self.openings[arm] = self._rws.number(symbol(arm, GRIP_ACTUAL)) / MILLIMETRES

    def close(self) -> None:
        """Log out."""
        self._stop.close()
        self._rws.close()
