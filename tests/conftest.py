"""Settings of all tests: what Hypothesis draws, how strict JAX is, where compiled code is kept."""

import os
import signal
from pathlib import Path

import jax
import pytest
from hypothesis import settings

# The same commit gives the same answer; `--hypothesis-profile=search` looks for what has not been found yet.
settings.register_profile("bt_jax", deadline=None, max_examples=30, derandomize=True)
settings.register_profile("search", deadline=None, max_examples=300)
settings.load_profile("bt_jax")

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
CACHE = Path(os.environ.get("BT_JAX_CACHE", Path.home() / ".cache" / "bt_jax"))
jax.config.update("jax_compilation_cache_dir", str(CACHE / "tests"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


@pytest.fixture(autouse=True)
def always_trace(monkeypatch):
    """Executables from the disk would hide what tracing checks: ranks, dtypes and annotations."""
    monkeypatch.setattr("bt_jax._util.compile_cache.keep_compiled", lambda folder: None)


def pytest_configure(config):
    """Background jobs of a script ignore SIGINT, and so would every process that a test starts and interrupts."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--rewrite-golden", action="store_true", help="write golden files instead of comparing with them")
