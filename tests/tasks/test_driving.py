"""Where a base stands and how it drives: clear of the tables, the shortest way, and only where the task can be done."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.tasks import Base, Robot, Table, load_task, task_from_dict
from bt_jax.tasks.roadmap import roadmap
from bt_jax.tasks.stations import in_reach, is_free, standing_places, wanted

MOBILE = load_task("mobile_stack")
CELL = 0.9  # of the grid on which random tables stand, so that a base fits between them


CELLS = st.sampled_from([(x, y) for x in range(4) for y in range(3)])
EDGES = st.floats(0.2, 0.6)
BETWEEN = st.tuples(st.integers(-1, 3), st.integers(-1, 2)).map(lambda at: tuple((i + 0.5) * CELL for i in at))


def room(cells, edges, start, stations, step):
    """A task with tables on a grid, and stations and the start between them."""
    tables = tuple(
        Table(f"T{i}", (x * CELL, y * CELL, 0.3), (*size, 0.6))
        for i, ((x, y), size) in enumerate(zip(cells, edges, strict=False))
    )
    base = Base(0.9, radius=0.14, step=step, stations=tuple(stations))
    return dataclasses.replace(MOBILE, tables=tables, robot_position=(*start, 0.7), robot=Robot(base))


@settings(max_examples=12)
@given(
    st.lists(CELLS, min_size=1, max_size=8, unique=True),
    st.lists(st.tuples(EDGES, EDGES), min_size=8, max_size=8),
    BETWEEN,
    st.lists(BETWEEN, min_size=1, max_size=3, unique=True),
    st.floats(0.1, 1.5),
)
def test_a_base_comes_to_every_station_on_the_shortest_way_and_touches_no_table(cells, edges, start, stations, step):
    task = room(cells, edges, start, stations, step)
    ways, base = roadmap(task), task.robot.base
    for first, (i, station) in itertools.product(range(len(ways.waypoints)), enumerate(ways.stations)):
        here, driven = first, 0.0
        while (after := ways.following[here][i]) != here:
            one, other = ways.waypoints[here], ways.waypoints[after]
            assert math.dist(one, other) <= base.step + 1e-3
            points = [tuple(a + s / 20 * (b - a) for a, b in zip(one, other, strict=True)) for s in range(21)]
            assert all(is_free(task.tables, point, base.radius - 2e-3) for point in points)
            driven, here = driven + math.dist(one, other), after
        assert ways.waypoints[here] == station
        assert driven == pytest.approx(ways.distances[first][i], abs=2e-3)
        assert driven >= math.dist(ways.waypoints[first], station) - 1e-3
    # A finer map, of points on a lattice and their neighbours, knows no shorter way.
    assert ways.distances[0] <= tuple(far + 1e-2 for far in _on_lattice(task))


def _on_lattice(task):
    """How far the stations are from the start over the points of a lattice, from each to those at most three away."""
    step, radius = CELL / 6, task.robot.base.radius
    near = [at for at in itertools.product(range(-3, 4), repeat=2) if math.gcd(*at) == 1]
    free = {
        (x, y)
        for x, y in itertools.product(range(-6, 25), range(-6, 19))
        if is_free(task.tables, (x * step, y * step), radius)
    }
    clear = {}

    def is_clear(one, other):
        if (one, other) not in clear:
            points = [tuple(step * (a + s / 8 * (b - a)) for a, b in zip(one, other, strict=True)) for s in range(9)]
            clear[one, other] = all(is_free(task.tables, point, radius) for point in points)
        return clear[one, other]

    def index(point):
        return tuple(round(c / step) for c in point)

    far, waiting = {index(task.robot_position[:2]): 0.0}, [index(task.robot_position[:2])]
    while waiting:
        here = waiting.pop(0)
        for dx, dy in near:
            other, length = (here[0] + dx, here[1] + dy), far[here] + step * math.hypot(dx, dy)
            if other in free and length < far.get(other, math.inf) - 1e-9 and is_clear(here, other):
                far[other] = length
                waiting.append(other)
    return [far.get(index(station), math.inf) for station in task.robot.base.stations]


@pytest.mark.parametrize("name", ["mobile_stack", "mobile_kit"])
def test_standing_places_are_found_from_which_everything_is_reached(name):
    task = load_task(name)
    places = standing_places(task)
    assert len(places) <= 2 * len(task.tables)
    assert all(is_free(task.tables, place, task.robot.base.radius) for place in places)
    assert all(any(in_reach(task, place, one.point) for place in places) for one in wanted(task))
    given_by_hand = dataclasses.replace(task, robot=Robot(dataclasses.replace(task.robot.base, stations=places)))
    assert roadmap(given_by_hand) == roadmap(task)


def test_ticks_leave_time_to_drive_unless_they_are_given():
    longest = roadmap(MOBILE).longest
    assert longest >= 6, "from one end to the other, a metre at a time"
    assert MOBILE.episode.action_ticks == longest, "the task that it extends gives 5"
    assert MOBILE.episode.max_ticks == 15 + 2 * 2 * longest
    data = MOBILE.to_dict()
    data["episode"]["max_ticks"] = 30
    assert task_from_dict(data, source="x").episode.max_ticks == 30


def refused(**base):
    return {"robot": {"base": {"reach": 0.9} | base}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (refused(reach=0.2), "robot.base.reach: an arm that reaches 0.2 m reaches nothing from beside the tables; write"),
        (refused(reach=900), "robot.base.reach: 900 is implausible; write 0.05 to 5 m (metres? 900 mm are 0.9 m)"),
        (refused(stations=[[0, 0.2]]), "robot.base.stations[0]: the base, 0.25 m in radius, would be inside TableMiddle"),
        (
            refused(stations=[[0, 0.8]]),
            "targets[0].position: no station reaches the place of YellowBox, 0.804 m high; add a station near it, or",
        ),
        (
            {"layout": {"kit": "TableMiddle"}, **refused(stations=[[0, 0.8]])},
            "robot.base.stations: no station reaches (-3.25, -0.25) on TableLeft, where objects may start, 0.8 m high; add",
        ),
        (refused(stations=[[9, 9], [9]]), "robot.base.stations[1]: expected two numbers, found [9]"),
        (refused(radius=0.9), "robot_position: the base, 0.9 m in radius, would be inside TableMiddle"),
        (refused(speed=2), "robot.base.speed: not known here; use one of reach, radius, step, stations"),
        ({"robot": {"base": {"radius": 0.2}}}, "robot.base.reach: missing; add it, for instance reach: 0.9"),
        (
            {"targets": [{"object": "YellowBox", "position": [0, 9, 0.05], "frame": "base_link"}]},
            "targets[0].position: no station reaches the place of YellowBox, 0.95 m high; raise robot.base.reach",
        ),
        (
            {"tables": [{"name": f"T{i}", "position": [x, y, 0.3], "size": [*size, 0.6]}
                        for i, (x, y, *size) in enumerate([(0, 2, 4, 0.6), (0, -2, 4, 0.6), (2, 0, 0.6, 4),
                                                           (-2, 0, 0.6, 4)])],
             "robot_position": [0, 0, 0.7], **refused(stations=[[0, 1], [5, 1]])},
            "robot.base.stations[1]: no way leads from the start to (5, 1); leave more room between the tables",
        ),
    ],
)  # fmt: skip
def test_a_base_that_cannot_work_is_refused_in_one_sentence(change, message):
    data = {**MOBILE.to_dict(), **change}
    with pytest.raises(UserError) as caught:
        task_from_dict(data, source="mine.yaml")
    assert str(caught.value).startswith(f"mine.yaml, key {message}")
    assert "\n" not in str(caught.value)
