"""What `python -m bt_jax.learn` does: infer a Behavior Tree from demonstrations, say why, and try it in simulation."""

from __future__ import annotations

import dataclasses
import json
import shlex
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.text import Text

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused, write_atomic
from bt_jax._util.startup import configure_jax
from bt_jax._util.words import counted
from bt_jax._util.yaml_files import to_yaml
from bt_jax.behaviors import Vocabulary
from bt_jax.commands.arguments import LearnArguments
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import Answer, DemonstrationFolder, Lesson, Proposal, Question, open_questions, propose
from bt_jax.lfd.explanation import (
    action_rows,
    goal_sentence,
    missing_sentence,
    order_sentences,
    precondition_sentences,
)
from bt_jax.lfd.figure import cluster_figure
from bt_jax.lfd.question_words import answer_words, answered_words, question_words, start_words
from bt_jax.lfd.questions import answered
from bt_jax.mjx_env.episodes.evaluator import Evaluation
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Target, Task, load_task, task_names
from bt_jax.training.levels import make_level
from bt_jax.training.phases import choose_frames, lesson_from
from bt_jax.training.settings import UNSEEN, Settings

__all__ = ["run"]


def run(arguments: LearnArguments) -> None:
    """Learn as the arguments say, print it and write the results."""
    console = Console(highlight=False, soft_wrap=True)
    arguments.check()
    settings = Settings(level=arguments.level, test_layouts=arguments.layouts)
    own = DemonstrationFolder(arguments.folder).task() if arguments.task is None else None
    task = own or load_task(arguments.task or "stack3")
    configure_jax("cpu")
    lesson = lesson_from(arguments.folder, task)
    if arguments.frames:
        lesson = choose_frames(arguments.folder, lesson, _choices(arguments.frames))
    lesson = _corrected(lesson, arguments)
    questions = open_questions(lesson)
    show(console, lesson, questions)
    proposal = propose(lesson, questions) if arguments.propose and questions else None
    tried = try_out(lesson, settings)
    out = arguments.out or unused(
        Path("runs") / f"learn-{arguments.folder.resolve().name}-{datetime.now():%Y%m%d-%H%M%S}"
    )
    write(out, lesson, tried, questions)
    if proposal is not None:
        show_proposal(console, proposal, arguments.folder, out)
    elif arguments.propose:
        console.print("propose    nothing is open, so no other demonstration is needed")
    console.print(_verdict(lesson, tried, arguments, out))
    console.print(f"results    {escape(str(out))}")


def _choices(words: Sequence[str]) -> dict[int, str | None]:
    """Return the frame that was chosen for each index of an action, None for auto."""
    found = {}
    for word in words:
        number, _, frame = word.partition("=")
        if not number.isdecimal() or not frame:
            raise UserError(f"--frames {word} is no choice; write ACTION=FRAME, for instance 2=GreenBox")
        found[int(number) - 1] = None if frame == "auto" else frame
    return found


def _corrected(lesson: Lesson, arguments: LearnArguments) -> Lesson:
    """Return what is learnt with the answers that are given, and without those that are taken back, and keep both. The
    numbers are those that were printed before. Raise UserError, and keep nothing, if there is no such question or answer."""
    folder, known = DemonstrationFolder(arguments.folder), answered(lesson)
    questions = open_questions(lesson) if arguments.answers else ()
    chosen = [_answer(word, questions) for word in arguments.answers]
    for number in arguments.take_back:
        if not 1 <= number <= len(known):
            most = f"give a number up to {len(known)}" if known else "leave out --take-back"
            raise UserError(f"there is no answer {number} to take back; {most}")
    for number in arguments.take_back:
        folder.take_back(lesson.demonstrations, known[number - 1].corrections)
    for answer in chosen:
        folder.correct(lesson.demonstrations, answer.corrections)
    return lesson_from(arguments.folder, lesson.task) if chosen or arguments.take_back else lesson


def _answer(word: str, questions: Sequence[Question]) -> Answer:
    """Return the answer that QUESTION=ANSWER means."""
    numbers = [int(part) for part in word.split("=") if part.isdecimal()]
    if len(numbers) != 2 or word.count("=") != 1:
        raise UserError(f"--answers {word} is no answer; write QUESTION=ANSWER with two numbers, for instance 1=2")
    question, answer = numbers
    if not questions:
        raise UserError("nothing is open; leave out --answers")
    if not 1 <= question <= len(questions):
        raise UserError(f"--answers {word}: there are the questions 1 to {len(questions)}; choose one of them")
    if not 1 <= answer <= len(questions[question - 1].answers):
        last = len(questions[question - 1].answers)
        raise UserError(f"--answers {word}: question {question} has the answers 1 to {last}; choose one of them")
    return questions[question - 1].answers[answer - 1]


def show(console: Console, lesson: Lesson, questions: Sequence[Question]) -> None:
    """Print what was inferred, from what, the tree, and what is open."""
    for problem in lesson.demonstrations.problems:
        console.print(f"[yellow]{escape(problem)}[/]")
    names = ", ".join(one.name for one in lesson.demonstrations)
    console.print(f"[bold]{counted(len(lesson.demonstrations), 'demonstration')}[/]: {escape(names)}")
    if sentence := missing_sentence(lesson):
        console.print(f"[yellow]{escape(sentence)}[/]")
    console.print("actions and their reference frames")
    for number, row in enumerate(action_rows(lesson), start=1):
        console.print(f"  {number} [bold]{escape(row['what'])}[/]   {row['seen']}\n    {escape(row['why'])}")
    for i, one in enumerate(lesson.subtasks, start=1):
        which = "" if len(lesson.subtasks) == 1 else f" {i}, of {_names(lesson, one.subtask.demonstrations)}"
        console.print(f"goal{which}: {escape(goal_sentence(one.subtask.goal))}")
        for sentence in (*order_sentences(lesson, one), *precondition_sentences(one)):
            console.print(f"  {escape(sentence)}")
    if len(lesson.subtasks) > 1:
        console.print("[yellow]the demonstrations end differently: each goal is tried in turn until one is reached[/]")
    console.print(Panel(Text(draw_text(lesson.tree).rstrip()), title="learnt tree", title_align="left"))
    for number, question in enumerate(questions, start=1):
        console.print(f"[yellow]question {number}: {escape(question_words(question, lesson))}[/]")
        for nth, answer in enumerate(question.answers, start=1):
            taken = "   (taken meanwhile)" if nth == 1 else f"   --answers {number}={nth}"
            console.print(f"  {nth} {escape(answer_words(question.kind, answer.value, lesson))}{taken}")
    if questions:
        console.print("answer so, or show it once more from the start that --propose arranges")
    for number, said in enumerate(answered(lesson), start=1):
        console.print(f"answered {number}: {escape(answered_words(said, lesson))}   --take-back {number}")


def show_proposal(console: Console, proposal: Proposal, folder: Path, out: Path) -> None:
    """Print what to demonstrate next, and write where it starts."""
    file = out / "next_start.yaml"
    write_atomic(file, to_yaml(proposal.task.to_dict()))
    console.print(f"propose    {escape(start_words(proposal.start, proposal.task))} Then show the same once more:")
    words = f"{shlex.quote(str(folder))} SCRIPT --task {shlex.quote(str(file))} --count 1"
    console.print(f"           python -m bt_jax.demonstrate {escape(words)}")


def _names(lesson: Lesson, demonstrations: tuple[int, ...]) -> str:
    return ", ".join(lesson.demonstrations.demonstrations[d].name for d in demonstrations)


def try_out(lesson: Lesson, settings: Settings) -> Evaluation:
    """Run the tree in layouts that nothing else uses, with the demonstrated places as the targets."""
    task = dataclasses.replace(lesson.task, targets=_reached_targets(lesson))
    semantics = LeafSemantics(task, Vocabulary.of(leaves(lesson.tree)))
    layouts = sample_layouts(task, [UNSEEN, 0], settings.test_layouts)
    return survey(semantics, make_level(task, settings), lesson.tree, layouts)


def _reached_targets(lesson: Lesson) -> tuple[Target, ...]:
    """Return one target for each object; if several goals are demonstrated, those of the first."""
    first = dataclasses.replace(lesson, subtasks=lesson.subtasks[:1])
    return first.targets


def write(out: Path, lesson: Lesson, tried: Evaluation, questions: Sequence[Question]) -> None:
    """Write the tree in three formats, the picture of the clusters, and everything inferred as JSON."""
    title = f"learnt from {counted(len(lesson.demonstrations), 'demonstration')}"
    write_atomic(out / "learnt_tree.txt", format_tree(lesson.tree))
    write_atomic(out / "learnt_tree.xml", to_xml(lesson.tree))
    write_atomic(out / "learnt_tree.svg", to_svg(lesson.tree, title=title))
    write_atomic(out / "clusters.png", cluster_figure(lesson))
    write_atomic(out / "task.yaml", to_yaml(lesson.task.to_dict()))
    write_atomic(out / "lesson.json", json.dumps(as_data(lesson, tried, questions), indent=2) + "\n")


def as_data(lesson: Lesson, tried: Evaluation, questions: Sequence[Question]) -> dict[str, Any]:
    """Return a lesson as plain data."""
    return {
        "demonstrations": [one.name for one in lesson.demonstrations],
        "problems": list(lesson.demonstrations.problems),
        "missing": lesson.missing,
        "actions": [
            {
                "behavior": str(inference.behavior),
                "frame": inference.frame,
                "chosen": inference.chosen,
                "turn": inference.turn,
                "slot": inference.slot,
                "tolerance": round(inference.tolerance, 5),
                "reason": inference.reason,
                "note": inference.note,
                "candidates": [
                    {
                        "frame": candidate.frame,
                        "score": candidate.score if np.isfinite(candidate.score) else None,
                        "size": candidate.size,
                        "spread": round(candidate.spread, 5),
                    }
                    for candidate in inference.candidates
                ],
            }
            for inference in lesson.inferences
        ],
        "questions": [
            {
                "kind": question.kind,
                "actions": [step + 1 for step in question.subject],
                "text": question_words(question, lesson),
                "answers": [
                    {"text": answer_words(question.kind, answer.value, lesson), "tree": str(answer.lesson.tree)}
                    for answer in question.answers
                ],
            }
            for question in questions
        ],
        "answered": [answered_words(said, lesson) for said in answered(lesson)],
        "goals": [list(map(str, one.subtask.goal)) for one in lesson.subtasks],
        "orders": [sentence for one in lesson.subtasks for sentence in order_sentences(lesson, one)],
        "tree": str(lesson.tree),
        "tried": int(tried.solved.size),
        "solved": int(tried.solved.sum()),
    }


def _verdict(lesson: Lesson, tried: Evaluation, arguments: LearnArguments, out: Path) -> str:
    """Say how often the tree has worked, and what to do if it does not always."""
    solved, count = int(tried.solved.sum()), tried.solved.size
    said = f"tried      reaches what was demonstrated in [bold]{solved} of {count}[/] random layouts"
    if solved < count:
        said += (
            ".\n           Demonstrations that begin where a tree has ended show only the last step:\n"
            "           let evolution find the rest with python -m bt_jax.train "
            f"{_origin(lesson.task, arguments, out)} --add-target-from {escape(shlex.quote(str(arguments.folder)))}"
        )
    return said


def _origin(task: Task, arguments: LearnArguments, out: Path) -> str:
    """Return the words that tell `train` where to begin: at the run whose tree went before the demonstrations, else with the
    task, by name if it comes with the package and otherwise by its file or the one that is written with the lesson, which
    says everything that older files leave open."""
    if (run := DemonstrationFolder(arguments.folder).run()) is not None:
        here = Path.cwd()
        return f"--resume {escape(shlex.quote(str(run.relative_to(here) if run.is_relative_to(here) else run)))}"
    if task.name in task_names() and _same(load_task(task.name), task):
        return task.name
    return f"--task {escape(shlex.quote(arguments.task or str(out / 'task.yaml')))}"


def _same(a: Task, b: Task) -> bool:
    """Return whether two tasks are the same to `train`; without subgoals, when they count as reached says nothing."""
    return a == (b if b.subgoals else dataclasses.replace(b, subgoal_reward=a.subgoal_reward))
