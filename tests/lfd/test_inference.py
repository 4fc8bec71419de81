import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.lfd.clustering import NEEDED, SPREAD_FLOOR
from bt_jax.lfd.demonstration import Demonstrations
from bt_jax.lfd.inference import infer
from bt_jax.tasks import Target
from tests.helpers.demonstrations import RESTACK, STACK3, STACKING, UNSTACKING, demonstrations

sets = st.fixed_dictionaries(
    {
        "placements": st.sampled_from([STACKING, STACKING[:1], UNSTACKING, (*UNSTACKING, *STACKING)]),
        "count": st.integers(1, 6),
        "seed": st.integers(0, 10**6),
        "noise": st.floats(0, 0.01),
    }
)


def made(settings):
    return demonstrations(STACK3, **settings)


@given(settings=sets)
def test_every_action_has_one_meaning(settings):
    shown = made(settings)
    inferences = infer(shown, STACK3)
    instances = [instance for one in inferences for instance in one.instances]
    assert len(instances) == len(set(instances)) == sum(len(one.actions) for one in shown)
    for one in inferences:
        own = [instance.demonstration for instance in one.instances]
        assert len(set(own)) == len(own)
        for instance in one.instances:
            assert shown.demonstrations[instance.demonstration].actions[instance.index].kind == one.kind


@given(settings=sets)
def test_targets_are_means(settings):
    shown = made(settings)
    for one in infer(shown, STACK3):
        points = np.array(
            [shown.demonstrations[m.demonstration].actions[m.index].handled(one.frame) for m in one.instances]
        )
        np.testing.assert_allclose(one.position, points.mean(axis=0), atol=0.0005001)
        spread = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
        assert one.tolerance == pytest.approx(spread)


@given(settings=sets)
def test_candidates_explain_the_choice(settings):
    shown = made(settings)
    for one in infer(shown, STACK3):
        assert one.reason
        if len(shown) < NEEDED:
            assert one.candidates == ()
            continue
        frames = [candidate.frame for candidate in one.candidates]
        expected = [name for name in shown.frames.names if one.kind == "pick" or name != one.object]
        assert sorted(frames) == sorted(expected)
        assert frames[0] == one.frame
        for candidate in one.candidates:
            if candidate.size > 1:
                score = candidate.size / max(candidate.spread, SPREAD_FLOOR)
                assert candidate.score == pytest.approx(score, rel=1e-4)
            else:
                assert candidate.score == -math.inf


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_demonstrations_mean_the_robots_frame(count):
    for one in infer(demonstrations(STACK3, STACKING, count=count), STACK3):
        assert one.frame == (one.object if one.kind == "pick" else "base_link")
        assert one.kind == "pick" or f"{count} of 3 demonstrations needed" in one.reason


@pytest.mark.parametrize("seed", range(10))
def test_the_order_of_demonstrations_does_not_matter(seed):
    shown = demonstrations(RESTACK, (*UNSTACKING, *STACKING), count=5, seed=seed)
    turned = Demonstrations(shown.frames, shown.demonstrations[::-1])
    one, other = (
        sorted((i.kind, i.object, i.frame, len(i.instances)) for i in infer(d, STACK3)) for d in (shown, turned)
    )
    assert one == other


def test_moved_frames_are_told():
    for seed in range(5):
        shown = demonstrations(STACK3, STACKING[:2], count=6, seed=seed, noise=0.0)
        places = [one for one in infer(shown, STACK3) if one.kind == "place"]
        assert [one.position for one in places] == [(0, 0, 0.052), (0, 0, 0.1)]
        assert [one.frame for one in places] == ["KittingBox", "YellowBox"]


@pytest.mark.parametrize("seed", range(10))
def test_part_of_the_demonstrations_does_not_beat_all_of_them(seed):
    """The kit stands on one of three tables, so that most demonstrations agree in the robot's frame by chance."""
    shown = demonstrations(
        STACK3, [Target("YellowBox", (0.133, 0.0, 0.052), "KittingBox")], count=5, seed=seed, noise=0.01
    )
    (place,) = [one for one in infer(shown, STACK3) if one.kind == "place"]
    assert place.frame == "KittingBox"
    assert len(place.instances) == 5


@pytest.mark.parametrize("seed", range(10))
def test_a_box_that_goes_away_is_no_frame(seed):
    """Both are put aside at the same table: each place is constant also in the frame of the other box."""
    shown = demonstrations(RESTACK, (*UNSTACKING, *STACKING), count=3, seed=seed, noise=0.01)
    aside = [one for one in infer(shown, STACK3) if one.kind == "place"][1]
    assert aside.object == "BlueBox"
    assert aside.frame in ("base_link", "KittingBox")  # the kit may have stood still


@pytest.mark.parametrize("seed", range(10))
def test_the_same_place_twice_is_two_actions(seed):
    there = Target("YellowBox", (0.0, 0.0, 0.052), "KittingBox")
    aside = Target("YellowBox", (-1.0, -0.64, 0.75), "base_link")
    places = [one for one in infer(demonstrations(STACK3, [there, aside, there], seed=seed), STACK3)
              if one.kind == "place"]  # fmt: skip
    assert [len(one.instances) for one in places] == [3, 3, 3]
    assert [one.instances[0].index for one in places] == [1, 3, 5]


def test_other_actions_nearby_do_not_spoil_a_cluster():
    """Two places 10 cm apart in the kit, each chosen in all demonstrations."""
    places = [Target("YellowBox", (x, 0.0, 0.052), "KittingBox") for x in (-0.05, 0.05)]
    for seed in range(5):
        found = [one for one in infer(demonstrations(STACK3, places, count=5, seed=seed), STACK3)
                 if one.kind == "place"]  # fmt: skip
        assert [one.frame for one in found] == ["KittingBox"] * 2
        np.testing.assert_allclose([one.position[0] for one in found], [-0.05, 0.05], atol=0.01)


@pytest.mark.parametrize("seed", range(6))
def test_first_and_second_places_are_not_mixed(seed):
    """As far apart as the tables are: with the kit on another table, the second place in it is where the first one was."""
    places = [Target("YellowBox", (x, -0.64, 0.75), "base_link") for x in (0.875, -0.125)]
    found = [one for one in infer(demonstrations(STACK3, places, count=5, seed=seed), STACK3)
             if one.kind == "place"]  # fmt: skip
    assert [one.frame for one in found] == ["base_link"] * 2
    assert [{instance.index for instance in one.instances} for one in found] == [{1}, {3}]


def test_one_frame_is_enough():
    shown = demonstrations(STACK3, [UNSTACKING[0]])
    frames = dataclasses.replace(shown.frames, names=("GreenBox", "base_link"))
    pick, place = infer(dataclasses.replace(shown, frames=frames), STACK3)
    assert (pick.frame, place.frame) == ("GreenBox", "base_link")
    assert place.reason.endswith("in base_link, the only frame")


def test_where_nothing_agrees_every_action_stands_alone():
    alone = [
        demonstrations(STACK3, [Target("YellowBox", (0.3 * i, 0.7 * i, 0.1 + i), "KittingBox")], count=1, seed=i)
        for i in range(3)
    ]
    shown = Demonstrations(alone[0].frames, tuple(one.demonstrations[0] for one in alone))
    places = [one for one in infer(shown, STACK3) if one.kind == "place"]
    assert [len(one.instances) for one in places] == [1, 1, 1]
    assert {one.frame for one in places} == {"base_link"}
    assert "no frame has 3 demonstrations that agree" in places[0].reason
