"""Convex hulls of few corners around the points of a surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, Delaunay, cKDTree
from scipy.spatial import QhullError as NotSolid

__all__ = ["Points", "beyond", "cut", "filled", "fitted", "halved", "outside"]

Points = Float[np.ndarray, "n 3"]
Normal = Float[np.ndarray, " 3"]
INWARD = 0.001  # m that a point of the surface may be outside of its hull
DIRECTIONS = 200  # of planes that are tried to cut a link in two
CUTS = 40  # in each direction
ROUNDS = 3000  # of making a hull smaller
LATTICE = 6  # parts of the edge of a triangle


def outside(points: Points, hulls: Sequence[Points]) -> Float[np.ndarray, " n"]:
    """Return how far each point is outside of the nearest hull, by its planes; negative inside."""
    equations = [ConvexHull(hull).equations for hull in hulls]
    return np.min([(points @ planes[:, :3].T + planes[:, 3]).max(axis=1) for planes in equations], axis=0)


def beyond(hulls: Sequence[Points], surface: Points, count: int = 20_000) -> Float[np.ndarray, " m"]:
    """Return how far random points and the corners of the surface of a union of hulls are from the nearest of `surface`."""
    rng, found, tree = np.random.default_rng(0), [], cKDTree(surface)
    for i, hull in enumerate(hulls):
        triangles = hull[ConvexHull(hull).simplices]
        edges = triangles[:, 1:] - triangles[:, :1]
        areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        chosen = triangles[rng.choice(len(triangles), count, p=areas / areas.sum())]
        points = np.concatenate([hull, (rng.dirichlet(np.ones(3), count)[:, None] @ chosen)[:, 0]])
        others = [other for k, other in enumerate(hulls) if k != i]
        found.append(points if not others else points[outside(points, others) >= 0])
    return tree.query(np.concatenate(found))[0]


def filled(points: Points, gap: float) -> Float[np.ndarray, "m 3"]:
    """Return the points of a surface and points between them: a lattice on every triangle of their Delaunay mesh whose
    circumcircle has a radius of at most `gap`."""
    cells = Delaunay(points).simplices
    faces = np.unique(np.sort(np.concatenate([np.delete(cells, k, axis=1) for k in range(4)]), axis=1), axis=0)
    corners = points[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    small = sides.prod(axis=1) <= gap * 4 * areas
    parts = [(i, j, LATTICE - i - j) for i in range(LATTICE + 1) for j in range(LATTICE + 1 - i)]
    between = np.einsum("wk,fkd->fwd", np.array(parts) / LATTICE, corners[small])
    return np.concatenate([points, between.reshape(-1, 3)])


def cut(points: Points, normal: Normal, level: float, gap: float) -> tuple[Points, Points]:
    """Return the points of a surface below and above a plane, both with the points where the plane cuts the lines between
    points less than `gap` apart."""
    return _cut(points, normal, level, cKDTree(points).query_pairs(gap, output_type="ndarray"))


def _cut(points: Points, normal: Normal, level: float, near: Int[np.ndarray, "k 2"]) -> tuple[Points, Points]:
    above = points @ normal - level - 1e-6
    a, b = near[above[near[:, 0]] * above[near[:, 1]] < 0].T
    seam = points[a] + (above[a] / (above[a] - above[b]))[:, None] * (points[b] - points[a])
    return np.concatenate([points[above < 0], seam]), np.concatenate([points[above >= 0], seam])


def halved(points: Points, gap: float) -> tuple[Points, Points]:
    """Return the two parts of a surface, cut by a plane, whose hulls have the least volume together."""
    near = cKDTree(points).query_pairs(gap, output_type="ndarray")
    best, parts = np.inf, None
    for normal in _directions(DIRECTIONS):
        for level in np.quantile(points @ normal, np.linspace(0.04, 0.96, CUTS)):
            tried = _cut(points, normal, level, near)
            try:
                volume = sum(ConvexHull(part).volume for part in tried)
            except (NotSolid, ValueError):  # too few points, or all in a plane
                continue
            if volume < best:
                best, parts = volume, tried
    assert parts is not None, "the points are in a plane"
    return parts


def _directions(count: int) -> Float[np.ndarray, "n 3"]:
    """Return directions that are spread evenly over half a sphere: a spiral with the golden angle."""
    part = np.arange(count) + 0.5
    height, turn = 1 - part / count, np.pi * (1 + 5**0.5) * part
    return np.stack([*(np.sqrt(1 - height**2) * (np.cos(turn), np.sin(turn))), height], axis=1)


def fitted(points: Points, corners: int) -> Points:
    """Return at most `corners` points whose hull is small and leaves no point outside by more than `INWARD`."""
    points = points[ConvexHull(points).vertices]
    hull = _grown(_farthest(points, corners), points)
    return _shrunk(hull, points)


def _farthest(points: Points, count: int) -> Points:
    """Return a choice of points: the outermost along each axis, then always the one farthest outside of their hull."""
    chosen = list(dict.fromkeys(int(k) for k in (*points.argmin(axis=0), *points.argmax(axis=0))))
    while len(chosen) < count:
        try:
            away = outside(points, [points[chosen]])
        except NotSolid:
            away = cKDTree(points[chosen]).query(points)[0]
        if away.max() < INWARD:
            break
        chosen.append(int(np.argmax(away)))
    return points[chosen]


def _grown(hull: Points, points: Points) -> Points:
    """Return the hull with its faces moved outwards until no point is outside by more than `INWARD`."""
    while True:
        solid = ConvexHull(hull)
        normals, offsets = solid.equations[:, :3], solid.equations[:, 3]
        lacking = (points @ normals.T + offsets).max(axis=0) - 0.9 * INWARD
        if lacking.max() <= 1e-5:
            return hull[solid.vertices]
        hull = hull.copy()
        for face in np.argsort(lacking):
            if lacking[face] > 0:
                hull[solid.simplices[face]] += 0.3 * lacking[face] * normals[face]


def _shrunk(hull: Points, points: Points) -> Points:
    """Return the hull with corners moved at random wherever that makes it smaller and leaves no point too far outside."""
    rng, volume, size = np.random.default_rng(0), ConvexHull(hull).volume, float(np.ptp(points, axis=0).max())
    for left in np.linspace(1, 0, ROUNDS):
        tried = hull.copy()
        tried[rng.integers(len(hull))] += rng.normal(size=3) * rng.random() * (0.05 * size * left + 0.0005)
        solid = ConvexHull(tried)
        fits = (points @ solid.equations[:, :3].T + solid.equations[:, 3]).max() <= INWARD
        if fits and solid.volume < volume and len(solid.vertices) == len(hull):
            hull, volume = tried, solid.volume
    return hull
