"""A process that waits to train, and outlives the page."""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bt_jax.app.processes.warm_worker import main
from bt_jax.training.progress import is_alive, read_progress

ROOT = Path(__file__).parents[3]
PAGE = """
import sys
from pathlib import Path

from bt_jax.app.state.evolution_process import EvolutionProcess
from bt_jax.app.state.workspace import Workspace
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task

evolution = EvolutionProcess(Workspace(Path(sys.argv[1])))
evolution.prepare(load_task("stack"))
evolution.start(load_task("stack"), GPConfig(population=8, generations=2, max_nodes=32))
"""


def test_it_compiles_for_the_device_that_train_takes(monkeypatch):
    devices = []
    monkeypatch.setattr("bt_jax._util.startup.configure_jax", lambda device="auto": devices.append(device))
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    monkeypatch.setattr(os, "nice", lambda by: 0)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    main()
    assert devices == ["auto"]


@pytest.mark.slow
def test_a_page_that_is_closed_while_the_process_compiles_loses_nothing(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", PAGE, str(tmp_path)], env=environment, check=True, timeout=120)
    end = time.monotonic() + 240
    while not (runs := list(tmp_path.glob("runs/*/progress.json"))):
        assert time.monotonic() < end, "the evolution was lost"
        time.sleep(0.1)
    (run,) = (path.parent for path in runs)
    while is_alive(run):
        assert time.monotonic() < end
        time.sleep(0.1)
    assert read_progress(run).stage == "finished"
