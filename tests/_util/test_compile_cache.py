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
from bt_jax._util.compile_cache import _described, keep_compiled, kept_jit
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


def test_code_is_kept_for_each_setting_of_jax(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path)

    @kept_jit
    def drawn(key):
        return jax.random.bits(key, (5,))

    key = jax.random.key_data(jax.random.key(0))
    found = {}
    for partitionable in (True, False):
        with jax.threefry_partitionable(partitionable):
            drawn.prepare(key)
            found[partitionable] = drawn(key).tolist()
            assert found[partitionable] == jax.jit(lambda key: jax.random.bits(key, (5,)))(key).tolist()
    assert found[True] != found[False]
    assert len(list(tmp_path.glob("*.bin"))) == 2


def test_code_that_cannot_be_kept_is_told_once(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path / "file")
    double = kept_jit(lambda x: 2 * x)
    with pytest.warns(UserWarning, match="not kept any more") as told:
        found = [double(np.ones(size, np.float32)).tolist() for size in (1, 2)]
    assert found == [[2], [2, 2]]
    assert len(told) == 1


def test_what_is_no_array_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path)
    with pytest.raises(TypeError, match="takes arrays, found int"):
        kept_jit(lambda x: 2 * x)(3)


def test_what_killed_processes_left_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_cache._Store, "folder", None)
    names = (".f-0123.bin.0123456789abcdef", ".f-4567.bin.0123456789abcdef", "f-0123.bin")
    for name in names:
        (tmp_path / name).write_text("")
    for name in (names[0], names[2]):
        os.utime(tmp_path / name, (0, 0))
    keep_compiled(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])
