import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bt_jax._util.compile_cache import _described
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
