"""Compiled functions that are kept on disk.

JAX's persistent cache saves a new process the compiling, not the tracing and lowering that come before, which for the
genetic operators take longer than a whole small evolution. `kept_jit` keeps the executable itself, under a key made of
everything it depends on: the function, its static arguments, shapes and types, JAX's options, the source of this package,
the versions of JAX and MuJoCo, the device. A file begins with a digest of the key and the code; one that does not match is
deleted and compiled again. The two do not mix: an executable that JAX has loaded from its cache cannot be written again, so
leave JAX's off where this is on.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import inspect
import os
import pickle
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.monitoring
import jax.numpy as jnp
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.signals import uninterrupted

__all__ = ["keep_compiled", "kept_jit"]


NOT_COMPILED = ("app", "deploy")  # parts of the package that nothing compiled depends on
OPTIONS = (
    "jax_enable_x64",
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_threefry_partitionable",
    "jax_random_seed_offset",
    "jax_numpy_dtype_promotion",
    "jax_numpy_rank_promotion",
    "jax_debug_nans",
    "jax_debug_infs",
)  # of JAX, that compiled code depends on
LIBRARIES = ("jax", "jaxlib", "mujoco", "mujoco-mjx")  # compiled code depends on their versions
COMPILE_FAST = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
LOAD_EVENT = "/bt_jax/load_executable_duration"
WAIT_EVENT = "/bt_jax/wait_for_executable_duration"

DIGEST_BYTES = 32  # at the beginning of a kept file
DAY = 86400.0  # s
# Static arguments; structure, shapes and types of the others; values of OPTIONS.
_Key = tuple[tuple[Any, ...], Any, tuple[Any, ...], tuple[Any, ...]]


class _Store:
    """Where executables are kept; nowhere until `keep_compiled` is called."""

    folder: Path | None = None


def keep_compiled(folder: Path) -> None:
    """Load functions made by `kept_jit` from `folder`, and keep them there, from now on."""
    _Store.folder = folder
    for unfinished in folder.glob(".*.bin.*"):  # by processes that were killed
        with contextlib.suppress(OSError):
            if time.time() - unfinished.stat().st_mtime > DAY:
                unfinished.unlink()


def kept_jit(
    function: Callable | None = None,
    *,
    static_argnames: tuple[str, ...] = (),
    donate_argnums: tuple[int, ...] = (),
    small: Callable[..., bool] | None = None,
) -> Any:
    """`jax.jit` whose executables outlive the process once `keep_compiled` was called.

    It works on functions without keyword-only parameters whose dynamic arguments are pytrees of arrays; with others a call
    raises TypeError. Executables are kept
    if the static arguments are numbers, strings, enums, module-level functions, tuples and dataclasses of these, or their
    methods; with other ones (a closure means nothing in another process), and inside another traced function, it is
    `jax.jit`.
    The method `prepare` of such a function compiles ahead in the background.

    On a CPU, calls for whose arguments `small` is true are compiled without optimizing, several times as fast: for work so
    little that its own time does not count. Give it only to functions whose results the optimizing does not change.
    """
    if function is None:
        return functools.partial(kept_jit, static_argnames=static_argnames, donate_argnums=donate_argnums, small=small)
    return _Kept(function, static_argnames, donate_argnums, small)


class _Kept:
    """A function made by `kept_jit`."""

    def __init__(
        self,
        function: Callable,
        static_argnames: tuple[str, ...],
        donate_argnums: tuple[int, ...],
        small: Callable[..., bool] | None,
    ) -> None:
        functools.update_wrapper(self, function)
        self._name = f"{function.__module__}.{function.__qualname__}"
        settings: dict[str, Any] = {"static_argnames": static_argnames, "donate_argnums": donate_argnums}
        self._jitted, self._small = jax.jit(function, **settings), small
        self._jitted_fast = jax.jit(function, compiler_options=COMPILE_FAST, **settings)
        self._signature = inspect.signature(function)
        self._static_at = [i for i, name in enumerate(self._signature.parameters) if name in static_argnames]
        self._dynamic_at = [i for i, name in enumerate(self._signature.parameters) if name not in static_argnames]
        self._ready: dict[_Key, Callable] = {}
        self._prepared: dict[_Key, Future[Callable | None]] = {}

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if kwargs or len(args) < len(self._signature.parameters):
            bound = self._signature.bind(*args, **kwargs)
            bound.apply_defaults()
            args = tuple(bound.arguments.values())
        dynamic = [args[i] for i in self._dynamic_at]
        leaves, structure = jax.tree.flatten(dynamic)
        if any([isinstance(leaf, jax.core.Tracer) for leaf in leaves]):
            return self._jitted(*args)
        if _Store.folder is None:
            return self._jit_for(args)(*args)
        key = self._key(args, leaves, structure)
        executable = self._ready.get(key)
        if executable is None:
            executable = self._ready[key] = self._awaited(key) or self._loaded(key, args)
        return executable(*dynamic)

    def prepare(self, *args: Any) -> None:
        """Begin to load or compile, in another thread, what a call with such arguments needs: all of them, arrays may be
        `jax.ShapeDtypeStruct`. That call waits for it, and raises what went wrong. Do nothing unless `keep_compiled` was
        called."""
        if _Store.folder is None:
            return
        key = self._key(args, *jax.tree.flatten([args[i] for i in self._dynamic_at]))
        if key not in self._ready and key not in self._prepared:
            with uninterrupted():  # a thread whose start is interrupted is never told to end
                self._prepared[key] = _background().submit(self._ahead, key, args)

    def _jit_for(self, args: tuple[Any, ...]) -> Any:
        fast = self._small is not None and self._small(*args) and _compiles_fast()
        return self._jitted_fast if fast else self._jitted

    def _key(self, args: tuple[Any, ...], leaves: list[Any], structure: Any) -> _Key:
        try:
            shapes = tuple([(leaf.shape, leaf.dtype) for leaf in leaves])
        except AttributeError:
            found = ", ".join(sorted({type(leaf).__name__ for leaf in leaves if not hasattr(leaf, "shape")}))
            raise TypeError(f"{self._name} takes arrays, found {found}; give np.asarray of it with a dtype") from None
        return tuple([args[i] for i in self._static_at]), structure, shapes, _options()

    def _loaded(self, key: _Key, args: tuple[Any, ...]) -> Callable:
        return _load(_Store.folder, self._name, key, lambda: self._jit_for(args).lower(*args).compile())

    def _ahead(self, key: _Key, args: tuple[Any, ...]) -> Callable | None:
        """Return the executable; None if the thread that asked for it has other options of JAX than this one."""
        return self._loaded(key, args) if key[-1] == _options() else None

    def _awaited(self, key: _Key) -> Callable | None:
        """Return the executable that was prepared, None if there is none."""
        if key not in self._prepared:
            return None
        began = time.perf_counter()
        executable = self._prepared[key].result()
        del self._prepared[key]
        jax.monitoring.record_event_duration_secs(WAIT_EVENT, time.perf_counter() - began)
        return executable


def _options() -> tuple[Any, ...]:
    """Return the values of OPTIONS in this thread."""
    return tuple([getattr(jax.config, name) for name in OPTIONS])


@functools.cache
def _compiles_fast() -> bool:
    """Return whether this is a CPU and an XLA that knows the options; they change from version to version."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=COMPILE_FAST).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


@functools.cache
def _background() -> ThreadPoolExecutor:
    """The threads that compile ahead; they are joined when the process ends."""
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="compile")


def _described(value: Any) -> Any:
    """Return a static argument as nested tuples whose `repr` says all of it, the same in every process; that of the argument
    itself may be abridged, or contain an address. Raise TypeError for an argument of another kind."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [(field.name, _described(getattr(value, field.name))) for field in dataclasses.fields(value)]
        return type(value).__module__, type(value).__qualname__, *fields
    if isinstance(value, tuple):
        return tuple([_described(item) for item in value])
    if isinstance(value, bool | int | float | str | bytes | enum.Enum | None):
        return type(value).__qualname__, repr(value)
    if inspect.ismethod(value):
        return _described(value.__self__), value.__name__
    if inspect.isfunction(value) and "<" not in value.__qualname__:
        return value.__module__, value.__qualname__
    raise TypeError(f"{value!r} does not say what it is")


def _load(folder: Path | None, name: str, key: _Key, compile_: Callable[[], Any]) -> Callable:
    """Return the executable from the store, or a new one that is put there."""
    if folder is None:
        return compile_()
    static, *others = key
    try:
        identity = "\n".join([name, repr(_described(static)), repr(others), _environment()])
    except TypeError:
        return compile_()
    path = folder / f"{name}-{hashlib.sha256(identity.encode()).hexdigest()[:32]}.bin"
    if path.is_file():
        try:
            began = time.perf_counter()
            content = path.read_bytes()
            found, code = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
            if found != _digest(identity, code):  # damaged code may crash, or compute other numbers
                raise ValueError("damaged")
            if b"lapack_" in code:
                _link_lapack()
            executable = deserialize_and_load(*pickle.loads(code))
            jax.monitoring.record_event_duration_secs(LOAD_EVENT, time.perf_counter() - began)
            return executable
        except Exception:
            with contextlib.suppress(OSError):
                path.unlink()
    executable = compile_()
    try:
        code = pickle.dumps(serialize(executable))
        write_atomic(path, _digest(identity, code) + code)
    except Exception as error:  # a full disk, or a backend that cannot write: results stay the same
        if _Store.folder is not None:
            _Store.folder = None
            why = f"{error} with BT_JAX_CACHE" if isinstance(error, UserError) else error
            print(f"warning: compiled code is not kept, so that starts are slower: {why}", file=sys.stderr)
    return executable


def _digest(identity: str, code: bytes) -> bytes:
    """Return what shows that code is whole and belongs to a key."""
    return hashlib.sha256(identity.encode() + code).digest()


@functools.cache
def _link_lapack() -> None:
    """JAX links LAPACK when it first lowers a function that needs it; an executable that is only loaded would call
    through null pointers."""
    jax.jit(jnp.linalg.cholesky).lower(jnp.zeros((1, 1), jnp.float32))


@functools.cache
def _environment() -> str:
    """Everything besides its arguments that compiled code depends on."""
    source = hashlib.sha256()
    package = Path(__file__).parents[1]
    for file in sorted(package.rglob("*.py")):
        if file.relative_to(package).parts[0] not in NOT_COMPILED:
            source.update(file.read_bytes())
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    flags = os.environ.get("XLA_FLAGS", "")
    versions = [importlib.metadata.version(library) for library in LIBRARIES]
    return repr((source.hexdigest(), versions, devices, flags, _processor()))


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        return ""
    return next((line for line in cpuinfo.read_text().splitlines() if line.startswith("flags")), "")
