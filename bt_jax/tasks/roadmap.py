"""How a base drives from one standing place to another without touching a table.

The shortest way around tables bends only at their corners, enlarged by the base's radius: it lies in the visibility graph of
these corners, the start and the stations (Lozano-Pérez and Wesley 1979). Its edges are cut into steps, so that a base is
always at one of finitely many waypoints, and where it goes next from each is known before an episode.
"""

from __future__ import annotations

import dataclasses
import functools
import heapq
import itertools
import math
from collections.abc import Iterable, Mapping

from bt_jax.tasks.robot import Base
from bt_jax.tasks.stations import base_of, is_free, standing_places, start_of
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Table, Vec2

__all__ = ["Roadmap", "roadmap"]

TOUCH = 1e-3  # metres by which a way may come nearer to a table than the radius
DIGITS = 4  # of coordinates and distances in metres, so that equal ways are equal

Graph = dict[Vec2, dict[Vec2, float]]


@dataclasses.dataclass(frozen=True)
class Roadmap:
    """Where a base may be between two ticks, and its way from there to each of the stations.

    The first waypoint is the start. `distances` are metres to drive, infinite where no way leads; `following` is the
    waypoint after one step, the same one where the base is there or no way leads.
    """

    waypoints: tuple[Vec2, ...]  # [W]
    stations: tuple[Vec2, ...]  # [n]
    distances: tuple[tuple[float, ...], ...]  # [W, n]
    following: tuple[tuple[int, ...], ...]  # [W, n]

    @property
    def longest(self) -> int:
        """The most steps that the way from a waypoint to a station has."""
        steps = 0
        for first, station in itertools.product(range(len(self.waypoints)), range(len(self.stations))):
            here, count = first, 0
            while self.following[here][station] != here:
                here, count = self.following[here][station], count + 1
            steps = max(steps, count)
        return steps


@functools.lru_cache(maxsize=16)
def roadmap(task: Task) -> Roadmap:
    """Return the ways of a task's base."""
    base, start, stations = base_of(task), _rounded(start_of(task)), tuple(map(_rounded, standing_places(task)))
    graph = _graph(task.tables, base, [start, *stations])
    trees = [_shortest(graph, station) for station in stations]
    index = {start: 0}
    for station in stations:
        index.setdefault(station, len(index))
    waiting = list(index)
    while waiting:
        here = waiting.pop()
        for _, towards in trees:
            following = towards.get(here, here)
            if following not in index:
                index[following] = len(index)
                waiting.append(following)
    return Roadmap(
        waypoints=tuple(index),
        stations=stations,
        distances=tuple(tuple(round(far.get(here, math.inf), DIGITS) for far, _ in trees) for here in index),
        following=tuple(tuple(index[towards.get(here, here)] for _, towards in trees) for here in index),
    )


def _graph(tables: tuple[Table, ...], base: Base, places: Iterable[Vec2]) -> Graph:
    """Return the points of all straight ways between places and corners, at most one step apart, and the metres between
    neighbours."""
    radius = base.radius - TOUCH
    corners = [_rounded(corner) for table in tables for corner in _corners(table, base.radius)]
    nodes = list(dict.fromkeys([*places, *(corner for corner in corners if is_free(tables, corner, radius))]))
    graph: Graph = {node: {} for node in nodes}
    for one, other in itertools.combinations(sorted(nodes), 2):
        if any(_crosses(one, other, table, radius) for table in tables):
            continue
        pieces = math.ceil(math.dist(one, other) / base.step)
        parts = [i / pieces for i in range(pieces + 1)]
        points = [_rounded((one[0] + at * (other[0] - one[0]), one[1] + at * (other[1] - one[1]))) for at in parts]
        for a, b in itertools.pairwise(points):
            graph.setdefault(a, {})[b] = graph.setdefault(b, {})[a] = math.dist(a, b)
    return graph


def _corners(table: Table, radius: float) -> list[Vec2]:
    """Return the corners of a table that is enlarged by a radius."""
    x, y = (edge / 2 + radius for edge in table.size[:2])
    return [(table.position[0] + a * x, table.position[1] + b * y) for a, b in itertools.product((-1, 1), (-1, 1))]


def _shortest(graph: Graph, station: Vec2) -> tuple[Mapping[Vec2, float], Mapping[Vec2, Vec2]]:
    """Return how far each point is from a station, and the next one on the way there (Dijkstra 1959)."""
    far, towards = {station: 0.0}, {station: station}
    waiting, done = [(0.0, station)], set[Vec2]()
    while waiting:
        distance, here = heapq.heappop(waiting)
        if here in done:
            continue
        done.add(here)
        for other, more in graph[here].items():
            if distance + more < far.get(other, math.inf):
                far[other], towards[other] = distance + more, here
                heapq.heappush(waiting, (distance + more, other))
    return far, towards


def _crosses(one: Vec2, other: Vec2, table: Table, radius: float) -> bool:
    """Return whether a straight way leads through the inside of a table that is enlarged by a radius."""
    first, last = 0.0, 1.0
    for axis in (0, 1):
        half, offset = table.size[axis] / 2 + radius, one[axis] - table.position[axis]
        along = other[axis] - one[axis]
        if along == 0:
            if abs(offset) >= half:
                return False
            continue
        enters, leaves = sorted(((-half - offset) / along, (half - offset) / along))
        first, last = max(first, enters), min(last, leaves)
    return first < last


def _rounded(point: Vec2) -> Vec2:
    x, y = point
    return round(x, DIGITS) + 0.0, round(y, DIGITS) + 0.0
