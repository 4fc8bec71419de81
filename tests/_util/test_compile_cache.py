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


FLIP = """
import sys
import numpy as np
from pathlib import Path
from bt_jax._util import compile_cache
from bt_jax._util.compile_cache import keep_compiled, kept_jit

written, serialize = [], compile_cache.serialize
compile_cache.serialize = lambda executable: written.append(1) or serialize(executable)

def rooted(x):
    return (x * x).sum() + 1

def called():
    return float(kept_jit(rooted)(np.arange(4, dtype=np.float32)))

folder = Path(sys.argv[1])
keep_compiled(folder)
assert called() == called() == 15
assert len(written) == 1
path, = folder.iterdir()
whole = path.read_bytes()
for at in np.linspace(0, len(whole) - 1, 25).astype(int):
    damaged = bytearray(whole)
    damaged[at] ^= 1 << at % 8
    path.write_bytes(damaged)
    assert called() == 15
    assert path.read_bytes() != bytes(damaged), at
for content in (b"", whole[:32], whole[32:], whole[: len(whole) // 2]):
    path.write_bytes(content)
    assert called() == 15
assert len(written) == 30, len(written)
print("sound")
"""


def test_a_kept_executable_with_a_flipped_bit_is_compiled_again(tmp_path):
    words = [sys.executable, "-c", FLIP, str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})
    assert (done.returncode, done.stdout) == (0, "sound\n"), done.stderr


def test_an_executable_under_the_name_of_another_is_compiled_again(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path)
    kept_jit(_double)(np.ones(3, np.float32))
    (first,) = tmp_path.iterdir()
    kept_jit(_halved)(np.ones(3, np.float32))
    other = next(path for path in tmp_path.iterdir() if path != first)
    other.write_bytes(first.read_bytes())
    assert kept_jit(_halved)(np.ones(3, np.float32)).tolist() == [0.5, 0.5, 0.5]


def _double(x):
    return 2 * x


def _halved(x):
    return x / 2


def test_an_executable_that_calls_lapack_is_loaded_by_a_new_process(tmp_path):
    for arguments in ([], ["loads"]):
        words = [sys.executable, "-c", FACTORIZE, str(tmp_path), *arguments]
        done = subprocess.run(words, capture_output=True, text=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})
        assert done.returncode == 0, done.stderr
        assert float(done.stdout) == 6
        assert len(list(tmp_path.glob("*.bin"))) == 1


def test_the_key_says_all_of_a_static_argument():
    task = load_task("stack")
    other = dataclasses.replace(task, objects=(*task.objects[:1], dataclasses.replace(task.objects[1], density=999.0)))
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


def test_code_that_cannot_be_kept_is_told_once(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(compile_cache._Store, "folder", tmp_path / "file")
    double = kept_jit(lambda x: 2 * x)
    found = [double(np.ones(size, np.float32)).tolist() for size in (1, 2)]
    assert found == [[2], [2, 2]]
    said = capsys.readouterr().err
    assert said.startswith("warning: compiled code is not kept, so that starts are slower: ")
    assert said.endswith("choose another folder with BT_JAX_CACHE\n")
    assert said.count("\n") == 1


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
