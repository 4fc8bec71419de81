"""The package as a wheel, installed outside the checkout."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import bt_jax

CHECKOUT = Path(__file__).parents[1]


@pytest.mark.slow
def test_an_installed_wheel_trains(tmp_path):
    source, site, work = tmp_path / "source", tmp_path / "site", tmp_path / "work"
    shutil.copytree(CHECKOUT / "bt_jax", source / "bt_jax", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(CHECKOUT / name, source)
    work.mkdir()
    options = {"check": True, "cwd": work, "env": os.environ | {"PYTHONPATH": str(site)}, "text": True}
    pip = [sys.executable, "-m", "pip", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "-w", tmp_path, source], **options)
    subprocess.run([*pip, "install", "--no-deps", "--target", site, next(tmp_path.glob("*.whl"))], **options)
    code = "import bt_jax; print(bt_jax.__file__, bt_jax.__version__, bt_jax.load_task('stack').name)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, **options).stdout.split()
    assert shown == [str(site / "bt_jax" / "__init__.py"), bt_jax.__version__, "stack"]
    assert (site / f"bt_jax-{bt_jax.__version__}.dist-info").is_dir()
    words = ["train", "stack", "--generations", "2", "--level", "kinematic", "--test-layouts", "5", "--out", "run"]
    subprocess.run([site / "bin" / "bt-jax", *words], **options)
    assert (work / "run" / "best_tree.xml").is_file()
