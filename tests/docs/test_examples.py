"""The scripts and the notebook of `examples` run as they are."""

import os
import subprocess
import sys

import nbformat
import pytest
from nbclient import NotebookClient

from tests.helpers.documents import ROOT

EXAMPLES = ROOT / "examples"
KEEP_COMPILED = "from bt_jax._util.startup import configure_jax; configure_jax('cpu')"


@pytest.mark.slow
@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_script_runs(script, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = f"import runpy; {KEEP_COMPILED}; runpy.run_path({str(script)!r}, run_name='__main__')"
    words = [sys.executable, "-c", run]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(KEEP_COMPILED))
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = {kind for cell in notebook.cells for output in cell.get("outputs", ()) for kind in output.get("data", ())}
    assert {"image/svg+xml", "image/png"} <= shown


def test_notebooks_are_kept_without_outputs():
    for path in EXAMPLES.glob("*.ipynb"):
        cells = nbformat.read(path, as_version=4).cells
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells), path
