import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.mjx_env.faults.events import ALL_SEEN, SPOTS, brings, hides, moves, takes
from bt_jax.mjx_env.faults.fates import sample_fates
from bt_jax.mjx_env.faults.variants import FRACTIONS, JAMS, NUM_ERRORS, SLIPS
from bt_jax.tasks import Faults, load_task, with_faults
from bt_jax.tasks.faults import PRESETS, only
from tests.helpers.samples import PARTS

STACK = with_faults(load_task("stack3"), PRESETS["harsh"])
KINDS = len(STACK.kinds)


def changed(**keys):
    return dataclasses.replace(STACK, faults=Faults(**keys))


def test_a_task_without_faults_has_no_fates():
    assert sample_fates(load_task("stack"), 0, layouts=2, draws=2) is None


@settings(max_examples=20)
@given(st.integers(0, 5), st.integers(0, 3), st.integers(1, 60))
def test_a_fate_follows_from_run_layout_draw_and_tick_alone(layout, draw, ticks):
    many = sample_fates(STACK, [7, 3], layouts=6, draws=4)
    shorter = dataclasses.replace(STACK, episode=dataclasses.replace(STACK.episode, max_ticks=ticks))
    few = sample_fates(shorter, [7, 3], layouts=layout + 1, draws=draw + 1)
    one, same, most = few[[-1]], many[[4 * layout + draw]], min(ticks, STACK.episode.max_ticks)
    np.testing.assert_array_equal(one.variant[:, :most], same.variant[:, :most])
    np.testing.assert_array_equal(one.person[:, :most], same.person[:, :most])
    np.testing.assert_array_equal(one.sight[:, :most], same.sight[:, :most])
    np.testing.assert_array_equal(one.heavy, same.heavy)


def test_fates_of_other_runs_layouts_and_draws_differ():
    fates = [sample_fates(STACK, seed, layouts=2, draws=2).variant for seed in (0, 1, [0, 1])]
    rows = np.concatenate(fates).reshape(12, -1)
    assert len(np.unique(rows, axis=0)) == 12


@pytest.mark.parametrize("name", ["slip", "drop", "jam", "misplace", "hide", "move", "take", "heavy"])
def test_the_other_faults_of_a_fate_are_the_same_whether_one_happens_or_not(name):
    alone = dataclasses.replace(STACK, faults=only(PRESETS["harsh"], name))
    both, one = (sample_fates(task, 0, layouts=20, draws=4) for task in (STACK, alone))
    slips = [fates.variant[..., 2 : 2 + KINDS] == SLIPS for fates in (one, both)]
    if name == "slip":
        assert slips[0].any()
        assert (slips[0] <= slips[1] | (both.variant[..., 2 : 2 + KINDS] == JAMS)).all()
    assert one.sight.any() == (name == "hide")
    assert one.person.any() == (name in ("move", "take"))
    assert one.heavy.any() == (name == "heavy")


def rate(found, expected, count):
    assert abs(found - expected) < 4 * np.sqrt(expected * (1 - expected) / count) + 1e-9


def test_faults_are_as_frequent_as_the_task_says():
    fates = sample_fates(changed(slip=0.2, jam=0.1, drop=0.3), 0, layouts=100, draws=5)
    picks, places = fates.variant[..., 2 : 2 + KINDS], fates.variant[..., 2 + KINDS :]
    rate((picks == SLIPS).mean(), 0.2, picks.size)
    rate((picks == JAMS).mean(), 0.1, picks.size)
    rate((fates.variant[..., :2] == JAMS).mean(), 0.1, fates.variant[..., :2].size)
    rate((places == 1).mean(), 0.1, places.size)  # without spread there are no errors
    for i in range(len(FRACTIONS)):
        rate((places == 2 + i).mean(), 0.3 / len(FRACTIONS), places.size)


def test_errors_are_drawn_evenly():
    fates = sample_fates(changed(place_spread=0.01), 0, layouts=100, draws=2)
    places = fates.variant[..., 2 + KINDS :]
    for i in range(NUM_ERRORS):
        rate((places == 1 + i).mean(), 1 / NUM_ERRORS, places.size)
    assert fates.unit is None


def test_continuous_errors_are_gaussian_and_leave_the_rest_as_it_is():
    plain, fates = (sample_fates(STACK, 0, layouts=40, draws=2, continuous=on) for on in (False, True))
    np.testing.assert_array_equal(plain.variant, fates.variant)
    assert abs(fates.unit.mean()) < 0.02
    assert abs(fates.unit.std() - 1) < 0.02


def test_what_is_heavy_slips_and_drops_more():
    fates = sample_fates(changed(heavy=0.5, heavy_slip=0.4), 0, layouts=100, draws=5)
    picks, heavy = fates.variant[..., 2 : 2 + KINDS] == SLIPS, fates.heavy[:, None]
    rate(fates.heavy.mean(), 0.5, fates.heavy.size)
    assert not (picks & ~heavy).any()
    rate(picks[np.broadcast_to(heavy, picks.shape)].mean(), 0.4, picks.size // 2)


def test_one_object_at_a_time_is_out_of_sight_for_as_long_as_the_task_says():
    fates = sample_fates(changed(hide=0.2, hide_ticks=3), 0, layouts=50, draws=4)
    assert {0, ALL_SEEN, *(hides(i) for i in range(3))} == set(np.unique(fates.sight).tolist())
    for events in fates.sight:
        for tick in np.flatnonzero(events >= hides(0)):
            if tick + 3 < len(events):
                assert events[tick + 1 : tick + 4].tolist() == [0, 0, ALL_SEEN]


def test_what_a_person_takes_away_comes_back():
    task = changed(take=0.1, take_ticks=4, move=0.1)
    fates = sample_fates(task, 0, layouts=50, draws=4)
    for events in fates.person:
        for tick in np.flatnonzero((events >= takes(task, 0)) & (events < moves(task, 0, 0))):
            if tick + 4 < len(events):
                thing = events[tick] - takes(task, 0)
                back = [brings(task, int(thing), spot) for spot in range(SPOTS)]
                assert events[tick + 1 : tick + 4].tolist() == [0, 0, 0]
                assert events[tick + 4] in back


def test_only_the_named_objects_are_concerned():
    task = load_task(PARTS)
    faults = dataclasses.replace(PRESETS["harsh"], slip=0.9, jam=0.0, drop=0.9, hide=0.5, move=0.4, objects=("Bolt",))
    task = with_faults(task, faults)
    fates = sample_fates(task, 0, layouts=20, draws=4)
    bolt, kinds = task.kinds.index("Bolt"), len(task.kinds)
    assert np.unique(np.nonzero(fates.variant[..., 2 : 2 + kinds] == SLIPS)[2]).tolist() == [bolt]
    own = [i for i, thing in enumerate(task.objects) if thing.part == "Bolt"]
    assert set(np.unique(fates.sight).tolist()) == {0, ALL_SEEN, *(hides(i) for i in own)}
    assert set(np.nonzero(fates.heavy)[1].tolist()) == {bolt}
    assert np.unique(np.nonzero(fates.variant[..., 2 + kinds :])[2]).tolist() == [bolt]
