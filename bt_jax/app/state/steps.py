"""The steps of the page: in which order they come, which are done, and what comes next."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal

from bt_jax._util.words import counted
from bt_jax.app.state.kit.complaints import complaints
from bt_jax.app.state.run_record import works
from bt_jax.app.state.studio import Studio
from bt_jax.lfd.clustering import NEEDED
from bt_jax.mjx_env.episodes.rules import Ending

__all__ = ["STEPS", "TITLES", "Advice", "Step", "advice", "done"]

Step = Literal["task", "evolve", "demonstrate", "understand", "combine", "run", "robot", "keep"]
TITLES: Mapping[Step, str] = MappingProxyType(
    {
        "task": "Task",
        "evolve": "Find",
        "demonstrate": "Show",
        "understand": "Check",
        "combine": "Combine",
        "run": "Run",
        "robot": "Robot",
        "keep": "Keep",
    }
)
STEPS: tuple[Step, ...] = tuple(TITLES)


@dataclasses.dataclass(frozen=True)
class Advice:
    """What comes next: a sentence, and the step to go to; `ready` says whether this step needs nothing more before."""

    sentence: str
    step: Step
    ready: bool = True


def done(studio: Studio) -> frozenset[Step]:
    """Return the steps that are done. Steps that never end are not among them."""
    return frozenset(step for step, is_done in _DONE.items() if is_done(studio))


def advice(studio: Studio, step: Step) -> Advice:
    """Say what comes after a step, as things are."""
    return _ADVICE[step](studio)


def _found(studio: Studio) -> bool:
    result = studio.evolution.result
    return result is not None and works(result)


def _shown(studio: Studio) -> int:
    return sum(one.counts for one in studio.library.kept)


def _understood(studio: Studio) -> bool:
    lesson, asked = studio.library.lesson, studio.library.asked
    return lesson is not None and not lesson.missing and asked is not None and not asked.questions


def _ran(studio: Studio) -> bool:
    player = studio.playing.player
    return player is not None and player.ending == Ending.SUCCESS and all(player.in_place)


_DONE: dict[Step, Callable[[Studio], bool]] = {
    "task": lambda studio: not complaints(studio.edited.task) and not studio.unsaved,
    "evolve": _found,
    "demonstrate": lambda studio: _shown(studio) >= NEEDED,
    "understand": _understood,
    "combine": lambda studio: bool(studio.evolution.phases),
    "run": _ran,
    "robot": lambda studio: studio.robot.ended is not None and studio.robot.ended.solved,
}


def _after_task(studio: Studio) -> Advice:
    if not studio.edited.task.targets:
        return Advice("Say first where something should be.", "evolve", ready=False)
    if complaints(studio.edited.task):
        return Advice("Something cannot work yet; the list above says what.", "evolve", ready=False)
    return Advice("Let the program find a way to do it.", "evolve")


def _after_evolve(studio: Studio) -> Advice:
    evolution = studio.evolution
    if evolution.stage == "none":
        return Advice("Press “Find a tree” first, or show how it is done.", "demonstrate", ready=False)
    if evolution.running:
        return Advice("It is still looking; you may already watch the best tree.", "run", ready=False)
    if _found(studio):
        return Advice("Watch the tree at work.", "run")
    return Advice("It does not do the whole task yet: show what is missing.", "demonstrate")


def _after_demonstrate(studio: Studio) -> Advice:
    missing = NEEDED - _shown(studio)
    if studio.teaching.session is not None:
        return Advice("Finish this demonstration first.", "understand", ready=False)
    if missing > 0:
        return Advice(f"Show it {counted(missing, 'more time')} first.", "understand", ready=False)
    return Advice("See what was understood.", "understand")


def _after_understand(studio: Studio) -> Advice:
    if studio.library.lesson is None:
        return Advice("Nothing was shown yet.", "demonstrate")
    following: Step = "run" if studio.evolution.run is None else "combine"
    if studio.library.asked is not None and studio.library.asked.questions:
        return Advice("Answer the question above first.", following, ready=False)
    if following == "run":
        return Advice("Watch the tree at work.", "run")
    return Advice("Put what you showed together with what was found.", "combine")


def _after_combine(studio: Studio) -> Advice:
    if studio.evolution.phases:
        return Advice("Watch the tree at work.", "run")
    return Advice("Press Go on evolving first, or watch the tree as it is.", "run", ready=False)


def _after_run(studio: Studio) -> Advice:
    player = studio.playing.player
    if studio.playing.tree is None:
        return Advice("There is no tree yet.", "evolve")
    if player is None or player.ending == Ending.OPEN:
        return Advice("Press Play first, and watch until the end.", "keep", ready=False)
    if _ran(studio):
        if studio.robot.refusal:
            return Advice("It works here. Keep it.", "keep")
        return Advice("It works here. Try it on the robot's twin.", "robot")
    return Advice("It did not do all: show what is missing.", "demonstrate")


def _after_robot(studio: Studio) -> Advice:
    robot = studio.robot
    if robot.running:
        return Advice("It still runs; watch until the end.", "keep", ready=False)
    if robot.refusal:
        return Advice("The robot's twin cannot run this one; keep what you have.", "keep")
    if robot.ended is None or robot.ended.interrupted:
        return Advice("Press Start first, and get in its way.", "keep", ready=False)
    if robot.ended.solved:
        return Advice("It works here, too. Keep it.", "keep")
    return Advice("It did not do all: show what is missing.", "demonstrate")


def _after_keep(studio: Studio) -> Advice:
    return Advice("Begin another task, or change this one.", "task")


_ADVICE: dict[Step, Callable[[Studio], Advice]] = {
    "task": _after_task,
    "evolve": _after_evolve,
    "demonstrate": _after_demonstrate,
    "understand": _after_understand,
    "combine": _after_combine,
    "run": _after_run,
    "robot": _after_robot,
    "keep": _after_keep,
}
