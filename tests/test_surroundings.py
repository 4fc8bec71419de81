"""The same commands under other surroundings: encodings, locales, and settings of JAX and Python that change no result."""

import io
import os
import sys

import pytest

from bt_jax import demonstrate, learn, run, train
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.history import history_csv
from bt_jax.training.settings import Settings
from bt_jax.training.training import evolve
from tests.helpers.samples import train as train_process

QUICK = ("stack", "--level", "kinematic", "--population", 8, "--max-nodes", 32, "--test-layouts", 4, "--generations", 3)
HOSTILE = {
    "JAX_ENABLE_X64": "1",
    "JAX_DEBUG_NANS": "1",
    "JAX_DEFAULT_MATMUL_PRECISION": "bfloat16",
    "JAX_DEFAULT_PRNG_IMPL": "rbg",
    "JAX_RANDOM_SEED_OFFSET": "3",
    "LC_ALL": "C",
    "PYTHONHASHSEED": "7",
    "PYTHONOPTIMIZE": "2",
    "TZ": "Asia/Tokyo",
    "COLUMNS": "20",
}


def test_the_same_seed_gives_the_same_evolution_under_other_surroundings(tmp_path):
    done = train_process(*QUICK, "--out", tmp_path / "run", "--device", "cpu", env=os.environ | HOSTILE)
    assert done.returncode == 0, done.stderr
    config = GPConfig(population=8, max_nodes=32, generations=3)
    here = evolve(load_task("stack"), config, Settings(level="kinematic", test_layouts=4))
    assert (tmp_path / "run" / "history.csv").read_text() == history_csv(here.history)


@pytest.fixture
def in_ascii(monkeypatch):
    """Runs a command in this process and returns what it wrote to a stdout that knows ASCII only."""

    def written(command, *words):
        out = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
        monkeypatch.setattr(sys, "stdout", out)
        with pytest.raises(SystemExit) as end:
            command.main(list(map(str, words)))
        assert end.value.code == 0
        return out.buffer.getvalue().decode("ascii")

    return written


def test_every_command_prints_where_there_is_only_ascii(tmp_path, in_ascii):
    tree, demonstrations = tmp_path / "tree.txt", tmp_path / "demonstrations"
    tree.write_text("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
    shown = in_ascii(run, tree, "--level", "kinematic", "--verbose")
    assert "+ `-- move(GreenBox, (0, 0, 0.1), YellowBox)" in shown
    shown = in_ascii(train, *QUICK, "--out", tmp_path / "run")
    assert "+- learnt tree --" in shown
    in_ascii(demonstrate, demonstrations, "pick BlueBox; to (0, 0, 0.11) GreenBox; release")
    shown = in_ascii(learn, demonstrations, "--level", "kinematic", "--layouts", 2, "--out", tmp_path / "lesson")
    assert "reaches what was demonstrated" in shown
