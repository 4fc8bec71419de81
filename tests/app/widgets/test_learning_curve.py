"""Learning curves: nothing that was measured is bent on its way to the picture."""

from hypothesis import given
from hypothesis import strategies as st

from bt_jax.app.widgets.learning_curve import POINTS, LearningCurve, curve_options

ROWS = st.lists(st.tuples(st.floats(-1e5, -10), st.floats(-1e5, -10)), min_size=1, max_size=1000).map(
    lambda pairs: [(generation, best, mean) for generation, (best, mean) in enumerate(pairs)]
)


@given(ROWS)
def test_every_point_is_one_that_was_measured(rows):
    best, mean = curve_options([LearningCurve("one", rows)])["series"]
    measured = {generation: (best, mean) for generation, best, mean in rows}
    for series, column in ((best, 0), (mean, 1)):
        assert all(-cost == measured[generation][column] for generation, cost in series["data"])
        places = [generation for generation, _ in series["data"]]
        assert places == sorted(set(places))
        assert (places[0], places[-1]) == (0, len(rows) - 1)
        assert len(places) == min(len(rows), POINTS)


@given(ROWS, ROWS)
def test_two_runs_are_told_apart_without_colour(one, two):
    options = curve_options([LearningCurve("one", one), LearningCurve("two", two)])
    a, b = options["series"]
    assert (a["name"], b["name"]) == ("one", "two")
    assert a["lineStyle"]["type"] != b["lineStyle"]["type"]
    assert options["xAxis"]["max"] == max(len(one), len(two), 2) - 1


def test_phases_are_marked_and_the_axis_is_as_long_as_the_evolution_will_be():
    options = curve_options([LearningCurve("one", [(0, -100.0, -200.0)], phases=(50,))], generations=100)
    assert options["series"][0]["markLine"]["data"] == [{"xAxis": 50}]
    assert options["xAxis"]["max"] == 100
    assert curve_options([])["series"] == []


def test_a_fitness_of_zero_has_a_place_on_the_axis():
    assert curve_options([LearningCurve("one", [(0, 0.0, 0.0)])])["series"][0]["data"][0][1] > 0
