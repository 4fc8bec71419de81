"""The paper's experiments, small: the protocol, the report, and what was published beside it."""

import dataclasses
import json
from typing import get_args

import numpy as np
import pytest

from bt_jax.experiments.protocol import EXPERIMENTS, Variant, perform
from bt_jax.experiments.published import published_curves
from bt_jax.experiments.report import figure, markdown, table
from tests.helpers.samples import command

PUBLISHED = ("with_demonstration", "gp_only")


def shortened(experiment):
    change, generations = (2, 4) if experiment.before else (0, 20)
    config = dataclasses.replace(experiment.config, generations=generations, max_nodes=32)
    return dataclasses.replace(experiment, change_at=change, config=config)


@pytest.fixture(scope="module")
def results():
    first, _, third = map(shortened, EXPERIMENTS)
    variants = [(first, variant) for variant in get_args(Variant)] + [(third, variant) for variant in PUBLISHED]
    return [perform(experiment, variant, runs=2, test_layouts=3) for experiment, variant in variants]


def test_both_published_variants_are_the_same_until_the_demonstration(results):
    ours, alone = results[:2]
    assert ours.best.shape == alone.best.shape == (2, 5)
    np.testing.assert_array_equal(ours.best[:, :3], alone.best[:, :3])
    assert (ours.best[:, 3] < ours.best[:, 2]).all()  # a third box is to be placed
    assert len(ours.history) == 2 * 5
    assert ours.lesson.tree.name == "move"
    assert alone.lesson is None


def test_the_method_of_this_package_goes_on_with_the_third_box(results):
    ours = results[2]
    assert ours.best.shape == (2, 5)
    assert ours.lesson is None
    assert max(ours.episodes) <= (5 + 1) * ours.experiment.config.population  # one is measured again for the third box


def test_the_lesson_of_unstacking_is_one_gene(results):
    ours = results[3]
    assert any(row.baseline_leaves for row in ours.history)


def test_the_report_shows_everything(results):
    curves = published_curves()
    assert figure(results[:3], curves).startswith(b"\x89PNG")
    text = markdown(results, curves, machine="here")
    for words in (
        "## Experiment 1",
        "## Experiment 3",
        "experiment_1.png",
        "place BlueBox at",
        "GP only, best run",
        "achievements, best run",
    ):
        assert words in text
    rows = table(results, curves)
    assert [row["published mean"] for row in rows] == ["-61", "-93", "", "-87", "-541"]


def test_the_published_curves_end_as_the_paper_says():
    ends = {key: round(curve.last) for key, curve in published_curves().items()}
    assert ends == {
        (1, "with_demonstration"): -61,
        (1, "gp_only"): -93,
        (2, "with_demonstration"): -88,
        (2, "gp_only"): -146,
        (3, "with_demonstration"): -87,
        (3, "gp_only"): -541,
    }


@pytest.mark.slow
def test_from_the_command_line(tmp_path):
    done = command("bt_jax.experiments", 1, "--runs", 2, "--test-layouts", 5, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [one["variant"] for one in data] == list(get_args(Variant))
    assert min(data[2]["unseen"]) == 1.0
    assert max(data[2]["episodes"]) <= min(data[1]["episodes"])
    assert min(best[-1] for best in data[0]["best"]) >= -65
    again = command("bt_jax.experiments", 1, "--out", tmp_path / "out")
    assert again.returncode == 2
    assert "choose another --out" in again.stderr
