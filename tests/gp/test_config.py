"""Settings: the paper's by default, and clear refusals."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.gp.config import GPConfig


def test_defaults_are_those_of_the_paper():
    config = GPConfig()
    config.check()
    assert (config.num_mutation_parents, config.num_crossover_parents, config.num_elites) == (12, 4, 2)
    assert config.num_offspring == 32
    assert (config.num_generations, dataclasses.replace(config, method="population").num_generations) == (1000, 50)


@given(st.integers(8, 100_000))
def test_shares_of_every_population_work(population):
    GPConfig(population=population).check()


@pytest.mark.parametrize(
    "wrong",
    [
        {"population": 7},
        {"population": 100_001},
        {"p_add": 0.5},
        {"p_add": -0.1, "p_delete": 0.7},
        {"crossover_parents": 3},
        {"mutation_parents": 17},
        {"mutation_parents": 1, "crossover_parents": 0, "old_share": 0.1},
        {"max_nodes": 256},
        {"init_nodes": 2},
        {"elites": 17},
        {"runs": 0},
        {"baseline_index": 0, "crossover_swap": True},
    ],
)
def test_what_cannot_work_is_refused(wrong):
    with pytest.raises(UserError, match=";"):
        dataclasses.replace(GPConfig(method="population"), **wrong).check()
