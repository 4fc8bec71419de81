"""Small drawings of where the demonstrations put an object."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from bt_jax.app.widgets.clusters import cluster_svg, scores
from bt_jax.lfd import learn
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task

TASK = load_task("stack3")
ON_GREEN = Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox")


def lesson(count, noise=0.005):
    shown = demonstration_set(TASK, [ON_GREEN], count=count, rng=np.random.default_rng(1), noise=noise)
    return learn(shown, TASK)


def circles(svg):
    root = ElementTree.fromstring(svg)
    found = root.findall("{http://www.w3.org/2000/svg}circle")
    return np.array([[float(one.get("cx")), float(one.get("cy"))] for one in found]), root


@pytest.mark.parametrize("frame", ["GreenBox", "YellowBox", "KittingBox", "base_link"])
def test_dots_are_where_the_demonstrations_are_seen(frame):
    learnt = lesson(4)
    place = learnt.inferences[1]
    dots, root = circles(cluster_svg(learnt, place, frame, task=TASK))
    shown = learnt.demonstrations.demonstrations
    points = np.array([shown[m.demonstration].actions[m.index].handled(frame) for m in place.instances])
    seen = points @ np.array([TASK.right, TASK.away]).T
    offsets, drawn = seen - seen.mean(axis=0), (dots - dots.mean(axis=0)) * [1, -1]
    scale = np.abs(drawn).max() / np.abs(offsets).max()
    np.testing.assert_allclose(drawn, scale * offsets, atol=0.2)
    assert dots.min() > 0
    assert dots.max() < 96
    bar = root.find("{http://www.w3.org/2000/svg}path[@class='cluster-bar']").get("d")
    pixels = float(re.search(r"H([\d.]+)", bar)[1]) - 2
    number, unit = root.find("{http://www.w3.org/2000/svg}text").text.split()
    assert pixels / scale == pytest.approx(0.001 * float(number), rel=0.03)
    assert unit == "mm"


def test_all_frames_but_its_own_can_be_meant():
    for count in (1, 3):
        learnt = lesson(count)
        found = scores(learnt, learnt.inferences[1])
        assert set(found) == {"YellowBox", "GreenBox", "KittingBox", "base_link"}
        assert all((one is None) == (count < 3) for one in found.values())
    assert next(iter(found)) == "GreenBox"
