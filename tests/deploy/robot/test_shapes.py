import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmarks import collision_shapes
from benchmarks._hulls import beyond, cut, filled, fitted, outside
from bt_jax.deploy.planning.collisions import CollisionModel
from bt_jax.deploy.robot.yumi import YUMI

SURFACE = Path(__file__).parents[4] / "shared/reference/yumi_surface.json"
SAMPLE = json.loads((Path(__file__).parents[2] / "data/yumi_surface.json").read_text())
"""28 points a link of the same surface: those that stand out most, the outermost along each axis, the rest spread evenly."""

HERE = RigidTransform.identity()


def ball(radius: float, count: int = 500) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("link", SAMPLE)
def test_the_shapes_cover_a_sample_of_the_surface(link):
    assert outside(np.array(SAMPLE[link]), collision_shapes.shapes_of(link)).max() < 0.002


@pytest.mark.skipif(not SURFACE.is_file(), reason="the points on the surface of YuMi are not beside this checkout")
@pytest.mark.parametrize("link", SAMPLE)
def test_the_shapes_cover_the_links_and_are_not_much_larger(link):
    points = np.array(json.loads(SURFACE.read_text())[link])
    hulls = collision_shapes.shapes_of(link)
    assert outside(points, hulls).max() < 0.002
    assert beyond(hulls, filled(points, collision_shapes.GAP.get(link, collision_shapes.OTHER_GAP))).max() < 0.015
    assert len(hulls) <= (5 if link == "body" else 4)
    assert max(map(len, hulls)) <= 36


def test_a_fitted_hull_has_few_corners_and_little_outside():
    points = ball(0.05)
    hull = fitted(points, 20)
    assert len(hull) <= 20
    assert outside(points, [hull]).max() <= 0.001 + 1e-9
    assert beyond([hull], points).max() < 0.015


def test_both_sides_of_a_cut_have_the_seam():
    below, above = cut(ball(0.05), np.array([0, 0, 1.0]), 0.01, 0.01)
    assert below[:, 2].max() == pytest.approx(0.01, abs=1e-5)
    assert above[:, 2].min() == pytest.approx(0.01, abs=1e-5)


def solids(shapes):
    return [shape.solid for shape in shapes]


def test_only_links_that_never_meet_or_always_nearly_touch_are_not_looked_at():
    model, arm, rng = CollisionModel(YUMI), YUMI.arm("left"), np.random.default_rng(5)
    numbers = {0: [model.add("body", YUMI.body, HERE, solid) for solid in solids(YUMI.shapes)]}
    for shape in arm.shapes:
        numbers.setdefault(shape.link, []).append(model.add("", arm.link_name(shape.link), HERE, shape.solid))
    counts = {link: min(k, 8 if isinstance(link, str) and "finger" in link else 7) for k, link in enumerate(numbers)}
    distant = [pair for pair in itertools.combinations(numbers, 2) if abs(counts[pair[0]] - counts[pair[1]]) > 1]
    unseen = [pair for pair in distant if not arm.may_meet(*pair)]
    pairs = [(pair, i, j) for pair in unseen for i in numbers[pair[0]] for j in numbers[pair[1]]]
    model.watch([(i, j) for _, i, j in pairs])
    nearest = []
    for _ in range(300):
        model.move({**YUMI.home, "left": rng.uniform(arm.lower, arm.upper)}, {})
        least = dict.fromkeys(unseen, np.inf)
        for k, (pair, _, _) in enumerate(pairs):
            least[pair] = min(least[pair], model.distance(k))
        nearest.append(list(least.values()))
    nearest = np.array(nearest)
    never, always = nearest.min(axis=0) > 0.015, (nearest < 0.01).mean(axis=0) > 0.95
    assert (never | always).all(), [pair for pair, fine in zip(unseen, never | always, strict=True) if not fine]
    assert {(0, 2), (0, 3), (1, 4), (2, 4), (2, "hand")} <= set(distant) - set(unseen)
