import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest, qmc

from bt_jax.behaviors import Behavior, gene_pool
from bt_jax.mjx_env.faults.fates import drawn, sample_fates
from bt_jax.mjx_env.faults.variants import FRACTIONS, NUM_ERRORS, SLIPS, SOBOL, Variants, bit, unit_errors
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act
from bt_jax.tasks import load_task, with_faults
from bt_jax.tasks.faults import PRESETS
from tests.helpers.samples import PARTS, random_commands, walk

HARSH = PRESETS["harsh"]


@functools.cache
def harsh(task_name):
    task = with_faults(load_task(task_name), HARSH)
    return LeafSemantics(task, gene_pool(task))


@functools.cache
def walked(task_name):
    semantics = harsh(task_name)
    return walk(semantics, Kinematic(semantics.task), seed=1, count=10, steps=5)[0]


def test_the_errors_are_shifted_points_of_sobol():
    ours = {tuple(point) for point in np.array(SOBOL).T.tolist()}
    theirs = qmc.Sobol(3, scramble=False).random(NUM_ERRORS) * NUM_ERRORS
    assert ours == {tuple(point) for point in theirs.astype(int).tolist()}


def test_over_places_each_draw_has_the_normal_distribution():
    draws = np.stack([unit_errors(f"at(YellowBox, ({i}, 0, 0), KittingBox)") for i in range(600)])
    for axis in range(3):
        assert kstest(draws[:, 0, axis], "norm").pvalue > 0.01
    far = np.linalg.norm(draws[..., :2], axis=-1) > 1.5  # as far as the tolerance of a coarse gripper
    assert abs(far.mean() - np.exp(-(1.5**2) / 2)) < 0.02


@pytest.mark.parametrize("task_name", ["stack3", PARTS])
def test_without_faults_every_command_is_one_column(task_name):
    task = load_task(task_name)
    semantics = LeafSemantics(task, gene_pool(task))
    count = np.arange(len(semantics.commands))
    variants = Variants(semantics)
    np.testing.assert_array_equal(variants.first, count)
    np.testing.assert_array_equal(variants.command, count)
    assert not variants.bits.any()


@pytest.mark.parametrize("task_name", ["stack3", PARTS])
def test_columns_stand_for_all_variants_of_all_commands(task_name):
    semantics = harsh(task_name)
    variants, picks = Variants(semantics), semantics.num_picks
    names = {0: set()}
    for column, command in enumerate(variants.command):
        names.setdefault(command, set()).add(variants.bits[column])
    assert names[0] == names[1] == {0, bit("jam")}
    assert all(names[2 + k] == {0, bit("jam"), bit("slip")} for k in range(picks))
    places = range(semantics.first_place, len(semantics.commands))
    assert all(names[place] == {0, bit("misplace"), bit("jam"), bit("drop")} for place in places)
    assert set(variants.counts[semantics.first_place :]) == {1 + NUM_ERRORS + 1 + len(FRACTIONS)}


@pytest.mark.parametrize("task_name", ["stack3", PARTS])
def test_what_goes_wrong_changes_only_what_it_is_about(task_name):
    semantics, world = harsh(task_name), walked(task_name)
    variants, rng = Variants(semantics), np.random.default_rng(0)
    command = random_commands(semantics, world, rng)
    variant = rng.integers(variants.counts[command]).astype(np.int32)
    mishaps = variants.mishaps(command, variant)
    plain, found = act(semantics, world, command), act(semantics, world, command, mishaps)
    assert mishaps.jams.any()
    assert mishaps.slips.any()
    assert (mishaps.share < 1).any()
    for name in ("poses", "held", "gripper_open"):
        np.testing.assert_array_equal(getattr(found.world, name)[mishaps.jams], getattr(world, name)[mishaps.jams])
    assert (found.world.held[mishaps.slips] == -1).all()
    assert not found.world.gripper_open[mishaps.slips].any()
    dropped = mishaps.share < 1
    assert (found.world.held[dropped] == -1).all()
    assert not found.world.gripper_open[dropped].any()
    tops = [(t.position[:2], np.array(t.size[:2]) / 2) for t in semantics.task.tables]
    for row in np.flatnonzero(dropped):
        xy = found.poses[row, world.held[row], :2]
        assert any((np.abs(xy - middle) <= half + 1e-6).all() for middle, half in tops)
    wrong = np.flatnonzero(mishaps.error.any(axis=1))
    off = (found.poses - plain.poses)[wrong, world.held[wrong], :2]
    np.testing.assert_allclose(off, mishaps.error[wrong, :2], atol=1e-6)
    right = ~mishaps.jams & ~mishaps.slips & ~dropped & ~mishaps.error.any(axis=1)
    np.testing.assert_array_equal(found.poses[right], plain.poses[right])


def test_jax_does_the_same():
    semantics, world = harsh("stack3"), walked("stack3")
    variants, rng = Variants(semantics), np.random.default_rng(0)
    command = random_commands(semantics, world, rng)
    variant = rng.integers(variants.counts[command]).astype(np.int32)
    ours = act(semantics, world, command, variants.mishaps(command, variant))

    @jax.jit
    def on_device(world, command, variant):
        return act(semantics, world, command, variants.mishaps(command, variant))

    theirs = on_device(*jax.tree.map(jnp.asarray, (world, command, variant)))
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-6)
    assert SLIPS in variant


def test_nothing_goes_wrong_with_a_look_or_a_drive():
    task = with_faults(load_task("mobile_stack"), PRESETS["harsh"])
    semantics = LeafSemantics(task, gene_pool(task).extended([Behavior("look", ("YellowBox",))]))
    variants, fates = Variants(semantics), sample_fates(task, 0, layouts=5, draws=4)
    safe = [i for i, command in enumerate(semantics.commands) if command.name in ("look", "approach")]
    assert {semantics.commands[i].name for i in safe} == {"look", "approach"}
    assert (variants.counts[safe] == 1).all()
    for tick in range(5):
        ticks, command = np.full(20, tick, np.int32), np.resize(safe, 20).astype(np.int32)
        variant, _ = drawn(fates, variants, ticks, command)
        assert not variant.any()
        mishaps = variants.mishaps(command, variant)
        assert not (mishaps.jams | mishaps.slips | (mishaps.share < 1) | mishaps.error.any(axis=1)).any()
