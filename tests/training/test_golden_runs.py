"""The published settings at seed 0 give what `tests/data/golden_runs.json` says: no seeded run has changed.

To write the file again after an intended change: `python -m pytest -m "slow or not slow" tests/training/test_golden_runs.py
--rewrite-golden`.
"""

import json
from pathlib import Path

import pytest

from bt_jax.encoding.formats.text import one_line
from bt_jax.tasks import load_task
from bt_jax.training.published import published_config
from bt_jax.training.training import evolve

GOLDEN = Path(__file__).parents[1] / "data" / "golden_runs.json"


NAMES = [
    "stack",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("pyramid", "restack", "stack3", "yumi_stack")),
]


@pytest.mark.parametrize("name", NAMES)
def test_published_run_is_unchanged(name, request):
    result = evolve(load_task(name), published_config(name))
    found = {
        "tree": one_line(result.tree),
        "fitness": round(result.fitness, 3),
        "episodes": result.history[-1].episodes,
        "solved_unseen": int(result.test.solved.sum()),
    }
    known = json.loads(GOLDEN.read_text()) if GOLDEN.exists() else {}
    if request.config.getoption("--rewrite-golden"):
        GOLDEN.write_text(json.dumps({**known, name: found}, indent=2, sort_keys=True) + "\n")
    else:
        assert found == known[name]
