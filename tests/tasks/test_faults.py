import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.tasks import Faults, load_faults, load_task, task_from_dict, task_names, with_faults
from bt_jax.tasks.changes import without_faults
from bt_jax.tasks.faults import FAULTS, PRESETS, only

STACK = load_task("stack")
CHANCES = ("slip", "drop", "jam", "hide", "move", "take", "heavy")
CASES = [
    ("slip: 20", "key slip: 20 is implausible; write 0 to 1 (20 % are 0.2)"),
    ("hide: -0.1", "key hide: -0.1 is implausible; write 0 to 1"),
    ("place_spread: 3", "key place_spread: 3 is implausible; write 0 to 0.1 m (metres? 3 mm are 0.003 m)"),
    ("turn_spread: 90", "key turn_spread: 90 is implausible; write 0 to 45 degrees"),
    ("take_ticks: 0", "key take_ticks: 0 is implausible; write 1 to 10000 ticks"),
    ("objects: [RedBox]", "key objects: there is no object 'RedBox'; use some of YellowBox, GreenBox"),
    ("{slip: 0.9, jam: 0.2}", "key slip: slip and jam add up to 1.1, more than 1; make one of them smaller"),
    ("slips: 0.1", "key slips: not known here; did you mean slip?"),
    ("slip: often", "key slip: expected a number, found 'often'"),
    ("[slip]", "expected a mapping, found ['slip']"),
]


@pytest.mark.parametrize(("text", "complaint"), CASES)
def test_faults_of_a_file_are_refused_in_one_sentence_with_file_and_key(tmp_path, text, complaint):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        with_faults(STACK, load_faults(path), source=str(path))
    assert str(path) in str(error.value)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_faults_of_a_task_are_refused_with_their_key_in_it(tmp_path):
    path = tmp_path / "mine.yaml"
    for text, complaint in [*CASES[:2], CASES[5]]:
        path.write_text(f"extends: stack\nname: mine\nfaults: {{{text}}}")
        with pytest.raises(UserError, match=r"mine\.yaml, key faults") as error:
            load_task(path)
        assert complaint.removeprefix("key ") in str(error.value)
    path.write_text("extends: stack\nname: mine\nfaults: rough")
    with pytest.raises(UserError, match="'rough' is unknown; use one of mild, harsh, or a mapping"):
        load_task(path)


@pytest.mark.parametrize("name", ["gentle", "gentle.yaml"])
def test_unknown_faults_are_refused_with_the_known_ones(name):
    with pytest.raises(UserError, match="choose one of mild, harsh"):
        load_faults(name)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("task_name", task_names())
def test_presets_fit_every_task_and_prolong_its_episodes_once(task_name, preset):
    task = load_task(task_name)
    changed = with_faults(task, PRESETS[preset])
    assert changed.episode.success_ticks == 6
    assert changed.episode.max_ticks == 2 * task.episode.max_ticks
    assert with_faults(changed, PRESETS["mild"]).episode == changed.episode
    assert task_from_dict(changed.to_dict(), source="mine") == changed


def test_a_task_has_its_own_ticks_or_those_that_faults_take(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: stack\nname: mine\nfaults: mild\n")
    assert load_task(path).episode == with_faults(STACK, PRESETS["mild"]).episode
    path.write_text("extends: stack\nname: mine\nfaults: {slip: 0.1}\nepisode: {max_ticks: 40}\n")
    assert load_task(path).episode == dataclasses.replace(STACK.episode, max_ticks=40, success_ticks=6)


@pytest.mark.parametrize("name", task_names())
def test_faults_come_and_go(name):
    task = load_task(name)
    harsh = with_faults(task, load_faults("harsh"))
    assert without_faults(with_faults(harsh, load_faults("mild"))) == without_faults(task) == task


def test_a_task_without_faults_is_kept_as_it_was():
    data = STACK.to_dict()
    assert data.pop("faults") is None
    assert task_from_dict(data, source="a folder from before", kept=True) == STACK


@given(st.sets(st.sampled_from(sorted(FAULTS))))
def test_faults_can_be_tried_alone(names):
    some = only(PRESETS["harsh"], *names)
    on = {name for name, keys in FAULTS.items() if any(getattr(some, key) for key in keys)}
    assert on == names


def test_every_chance_is_of_one_fault():
    keys = [key for keys in FAULTS.values() for key in keys]
    assert sorted(keys) == sorted({*CHANCES, "place_spread", "turn_spread"})
    assert all(getattr(Faults(), key) == 0 for key in keys)
