"""The next demonstration that is proposed."""

import dataclasses

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax._util.yaml_files import to_yaml
from bt_jax.lfd import learn, open_questions, propose
from bt_jax.lfd.evaluation.synthetic import demonstrate
from bt_jax.lfd.question_words import start_words
from bt_jax.lfd.questions import task_of
from bt_jax.lfd.rehearsal import parting, rehearse
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations
from tests.lfd.test_questions import last_move


@pytest.mark.parametrize("seed", [3, 4])
def test_all_answers_part_where_it_starts_and_the_demonstration_settles_it(seed, tmp_path):
    tied = last_move(STACK3, STACKING, seed=seed, noise=0.003)
    lesson = learn(tied, STACK3)
    questions = open_questions(lesson)
    proposal = propose(lesson, questions, seed=seed, searched=12)
    (asked,) = questions
    does = [rehearse(one.lesson.tree, task_of(one.lesson), proposal.start)[0] for one in asked.answers]
    apart = [parting(one, other, STACK3) for i, one in enumerate(does) for other in does[:i]]
    assert min(apart) == pytest.approx(proposal.parted[0])
    assert min(apart) > 5
    # The task that is written starts there, whatever the seed.
    file = tmp_path / "next_start.yaml"
    file.write_text(to_yaml(proposal.task.to_dict()))
    start = sample_layouts(load_task(file), seed, 1)
    np.testing.assert_allclose(start.poses, proposal.start.poses, atol=1e-4)
    np.testing.assert_allclose(start.kits, proposal.start.kits, atol=1e-6)
    once = demonstrate(
        STACK3, STACKING[2:], rng=np.random.default_rng(seed), noise=0.003, name="demo4", start=proposal.start
    )
    more = learn(dataclasses.replace(tied, demonstrations=(*tied.demonstrations, once)), STACK3)
    assert open_questions(more) == ()
    assert more.inferences[-1].frame == "GreenBox"


def test_where_things_start_is_said():
    lesson = learn(last_move(STACK3, STACKING), STACK3)
    words = start_words(propose(lesson, open_questions(lesson), searched=4).start, STACK3)
    assert words.startswith("Start with the kit")
    assert all(name in words for name in STACK3.object_names)
    assert sum(table.name in words for table in STACK3.tables) >= 2


def test_nothing_is_proposed_where_nothing_is_open():
    lesson = learn(demonstrations(STACK3, STACKING[:1]), STACK3)
    with pytest.raises(UserError, match="leave nothing open"):
        propose(lesson, ())
