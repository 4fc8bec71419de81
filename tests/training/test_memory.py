"""The largest case that a task may be, 16 objects in four trays, evolves within the memory that the table may take."""

import dataclasses
from pathlib import Path

import pytest

from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training
from tests.helpers.samples import assert_same

LARGEST = Path(__file__).parents[2] / "benchmarks/tasks/largest.yaml"
GB = 1 << 30
SMALL = 0.002  # GB, room for some 400 of its states


@pytest.mark.slow
@pytest.mark.parametrize(("method", "population", "layouts"), [("achievements", 16, 1), ("population", 32, 2)])
def test_the_largest_task_evolves_within_its_memory_with_the_same_results(method, population, layouts):
    task = load_task(str(LARGEST))
    assert (len(task.objects), len(task.kits)) == (16, 4)
    config = GPConfig(method=method, population=population, generations=5, max_nodes=32)
    settings = Settings(level="kinematic", layouts=layouts)
    small, large = (
        Training(task, config, dataclasses.replace(settings, memory=memory)) for memory in (SMALL, settings.memory)
    )
    for state, same in zip(small.evolution.run(), large.evolution.run(), strict=True):
        assert_same((state.population, state.knowledge), (same.population, same.knowledge))
        assert small.table.nbytes <= SMALL * GB
        assert large.table.nbytes <= settings.memory * GB
    assert small.table.num_restarts > 0 == large.table.num_restarts
