import dataclasses
import os
import subprocess
import sys
import threading
from pathlib import Path

import jax
import numpy as np
import pytest

from bt_jax._util import compile_cache
from bt_jax._util.compile_cache import _described, kept_jit
from bt_jax.tasks import load_task

FACTORIZE = """
import sys
import jax.numpy as jnp
from pathlib import Path
from bt_jax._util import compile_cache
from bt_jax._util.compile_cache import keep_compiled, kept_jit

@kept_jit(static_argnames=("scale",))
def factorize(matrix, scale):
    return jnp.linalg.cholesky(matrix) * scale

keep_compiled(Path(sys.argv[1]))
if sys.argv[2:] == ["loads"]:
    compile_cache.serialize = None  # whoever compiles would need it
print(float(factorize(4 * jnp.eye(2), 3.0)[0, 0]))
"""


def test_an_executable_that_calls_lapack_is_loaded_by_a_new_process(tmp_path):
    for arguments in ([], ["loads"]):
        words = [sys.executable, "-c", FACTORIZE, str(tmp_path), *arguments]
        done = subprocess.run(words, capture_output=True, text=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})
        assert done.returncode == 0, done.stderr
        assert float(done.stdout) == 6
        assert len(list(tmp_path.glob("*.bin"))) == 1


def test_the_key_says_all_of_a_static_argument():
    task = load_task("stack")
    other = dataclasses.replace(task, boxes=(*task.boxes[:1], dataclasses.replace(task.boxes[1], density=999.0)))
    assert _described(task) == _described(load_task("stack"))
    assert _described(task) != _described(other)
    assert _described(1) != _described(True)
    assert _described((1, 2)) != _described((12,))


def test_closures_have_no_key():
    with pytest.raises(TypeError):
        _described(lambda: Path())


def test_a_prepared_function_is_compiled_once_and_in_another_thread(tmp_path, monkeypatch):
    traced = []

    @kept_jit
    def double(x):
        traced.append(threading.current_thread())
        return 2 * x

    shape = jax.ShapeDtypeStruct((3,), np.float32)
    double.prepare(shape)
    assert not traced, "a process that keeps nothing is left alone"
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path)
    double.prepare(shape)
    double.prepare(shape)
    assert double(np.ones(3, np.float32)).tolist() == [2, 2, 2]
    assert len(traced) == 1
    assert threading.current_thread() not in traced


def test_what_goes_wrong_in_the_background_is_raised_by_the_call(tmp_path, monkeypatch):
    @kept_jit
    def wrong(x):
        raise ValueError("no such tree")

    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path)
    wrong.prepare(jax.ShapeDtypeStruct((3,), np.float32))
    with pytest.raises(ValueError, match="no such tree"):
        wrong(np.ones(3, np.float32))
