"""Damage to files, as people and machines do it: each mutation is a function of a file and a random generator."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["mutate"]

NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
NUMBERS = (
    b"nan", b".nan", b"NaN", b"inf", b"-.inf", b"1e999", b"-1", b"0", b"-0.0", b"1e308", b"5e-324", b"1e-9", b"1e5",
    b"52", b"-52", b"255", b"010", b"0x10", b"1_000", b"1:30", b"1,5", "\N{MINUS SIGN}1".encode(), b"1" * 30, b"9" * 5000,
    b"2147483648", b"true", b"null", b"[]", b"{}", b'""', b"'1'", b"No", b"",
    b"!!bool x", b"!!int ''", b"!!float x", b"!!null 0", b"!!int 0x", b"-_", b"-0o_", b"0.0_5",
)  # fmt: skip
WORDS = (
    b"", b"No", b"null", b"a b", b"x" * 100_000, b"../../etc/passwd", b"KittingBox", b"YellowBox", b"Sequence",
    b"[red]", b"\x1b[31m", b"\x00", "ä".encode(), "箱子".encode(), "🤖".encode(), b"!!python/object/apply:os.system",
    b"!!bool maybe", b"!!int ''", b"!!map a", b'"\\UFFFFFFFF"',
    b"&a [*a]", b"*a", b"<!DOCTYPE a>", b"&lol;", b"%s%n", b"$HOME", b"-", b"#", b"'", b'"', b"<", b"(", b")", b"{", b"]",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1e308, 10**30, -5e-324, float("nan"), float("inf"), 1.5, 2**63, 2**31),
    *(
        "",
        "YellowBox",
        "x" * 10_000,
        "1",
        "\x00",
        "\ud800",
        [],
        {},
        [[]],
        {"": 0},
        [0] * 1000,
        [None],
        {"a": {"b": {}}},
    ),
)
DEPTHS = (20, 100, 3000, 100_000)


def mutate(folder: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> str:
    """Damage one or two files of a folder, and return what was done; `strangers` are files of other kinds."""
    done = []
    for _ in range(1 + int(rng.random() < 0.3)):
        files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
        if not files:
            break
        path = files[int(rng.integers(len(files)))]
        name, change = MUTATIONS[int(rng.integers(len(MUTATIONS)))]
        change(path, rng, strangers)
        done.append(f"{name} {path.relative_to(folder)}")
    return ", ".join(done)


def _bytes(change: Callable[[bytes, np.random.Generator], bytes]) -> Callable[..., None]:
    """Return the mutation that replaces a file's content."""

    def apply(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
        path.write_bytes(change(path.read_bytes(), rng))

    return apply


def _span(data: bytes, rng: np.random.Generator) -> tuple[int, int]:
    """Return a random part of the data, more often a short one."""
    start = int(rng.integers(len(data) + 1))
    length = int(min(len(data) - start, rng.exponential(20) if rng.random() < 0.7 else rng.integers(len(data) + 1)))
    return start, start + length


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9)) if data else 0):
        changed[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _repeat(data: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(data, rng)
    return data[:end] + data[start:end] * int(rng.choice([1, 2, 50])) + data[end:]


def _insert(data: bytes, rng: np.random.Generator) -> bytes:
    start, _ = _span(data, rng)
    return data[:start] + rng.bytes(int(rng.integers(1, 40))) + data[start:]


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.integers(len(lines), size=2)
    match int(rng.integers(4)):
        case 0:
            lines[i], lines[j] = lines[j], lines[i]
        case 1:
            lines.insert(int(i), lines[j])
        case 2:
            del lines[i]
        case _:
            lines[i] = b"  " * int(rng.integers(1, 4)) + lines[i]
    return b"\n".join(lines)


def _token(pattern: re.Pattern[bytes], replacements: Sequence[bytes]) -> Callable[[bytes, np.random.Generator], bytes]:
    """Return the change that writes something else in the place of one match, or of all that read alike."""

    def change(data: bytes, rng: np.random.Generator) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        match, new = found[int(rng.integers(len(found)))], replacements[int(rng.integers(len(replacements)))]
        if rng.random() < 0.2:
            return data.replace(match.group(), new)
        return data[: match.start()] + new + data[match.end() :]

    return change


def _nest(data: bytes, rng: np.random.Generator) -> bytes:
    opening, closing = [(b"[", b"]"), (b"{a: ", b"}"), (b"(", b")"), (b"<Sequence>", b"</Sequence>"), (b'{"a":', b"}")][
        int(rng.integers(5))
    ]
    depth, (start, end) = int(rng.choice(DEPTHS)), _span(data, rng)
    inside = data[start:end] or b"0"
    return data[:start] + opening * depth + inside + closing * (depth if rng.random() < 0.7 else 0) + data[end:]


def _indent(data: bytes, rng: np.random.Generator) -> bytes:
    return b"\n".join(b" " * (2 * i) + b"Sequence" for i in range(int(rng.choice(DEPTHS[:3])))) + b"\n" + data


def _encoding(data: bytes, rng: np.random.Generator) -> bytes:
    text = data.decode("utf-8", "replace")
    match int(rng.integers(7)):
        case 0:
            return text.encode("utf-16")
        case 1:
            return text.encode("utf-8-sig")
        case 2:
            return text.encode("utf-32")
        case 3:
            return text.replace("e", "é").encode("latin-1", "replace")
        case 4:
            return text.replace("\n", "\r\n").encode()
        case 5:
            return text.replace("\n", "\r").encode()
        case _:
            return text.replace(" ", "\N{NO-BREAK SPACE}").encode()


def _structure(data: bytes, rng: np.random.Generator) -> bytes:
    """Change one value of what a JSON text holds; of JSON lines, in one of them."""
    lines = data.split(b"\n")
    i = int(rng.integers(len(lines)))
    for start, end in ((0, len(lines)), (i, i + 1)):
        try:
            value = json.loads(b"\n".join(lines[start:end]))
        except ValueError:
            continue
        changed = json.dumps(_changed(value, rng)).encode("utf-8", "surrogatepass")
        return b"\n".join([*lines[:start], changed, *lines[end:]])
    return _token(NUMBER, NUMBERS)(data, rng)


def _changed(value: Any, rng: np.random.Generator) -> Any:
    """Return plain data with one value replaced, removed, renamed or doubled."""
    keys = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    if not keys or rng.random() < 0.1:
        return VALUES[int(rng.integers(len(VALUES)))]
    key = keys[int(rng.integers(len(keys)))]
    if rng.random() < 0.6:
        value[key] = _changed(value[key], rng)
    elif rng.random() < 0.5:
        del value[key]
    elif isinstance(value, dict):
        value[f"{key}x"] = value.pop(key)
    else:
        value.insert(key, value[key])
    return value


def _archive(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    """Change one array of an archive of NumPy; of other files, their bytes."""
    if path.suffix != ".npz":
        path.write_bytes(_cut(path.read_bytes(), rng))
        return
    with np.load(path) as data:
        arrays: dict[str, Any] = dict(data)
    name = sorted(arrays)[int(rng.integers(len(arrays)))]
    array = arrays[name]
    match int(rng.integers(7)):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = array.astype(rng.choice(["float16", "float64", "int64", "int8", "bool", "complex64"]))
        case 2:
            arrays[name] = array[: int(rng.integers(array.shape[0]))] if array.ndim and array.shape[0] else array[None]
        case 3:
            arrays[name] = np.full_like(array, rng.choice([0, 1, 100]))
        case 4:
            arrays[name] = np.full(array.shape, rng.choice([np.nan, np.inf, -1e30, 1e9]))
        case 5:
            arrays[name] = np.concatenate([array, array]) if array.ndim else np.array([array, array])
        case _:
            arrays[name] = rng.permutation(array.ravel()).reshape(array.shape)
    np.savez(path, **arrays)


def _swap(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    shutil.copyfile(strangers[int(rng.integers(len(strangers)))], path)


def _directory(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    path.unlink()
    path.mkdir()


def _link(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    path.unlink()
    os.symlink(path if rng.random() < 0.5 else path.with_name("nowhere"), path)


def _remove(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    path.unlink()


def _copy(path: Path, rng: np.random.Generator, strangers: Sequence[Path]) -> None:
    for name in (f"{path.stem} copy{path.suffix}", f"{path.stem}_v2{path.suffix}"):
        shutil.copyfile(path, path.with_name(name))


MUTATIONS: tuple[tuple[str, Callable[[Path, np.random.Generator, Sequence[Path]], None]], ...] = (
    ("bits flipped in", _bytes(_flip)),
    ("cut out of", _bytes(_cut)),
    ("end cut off", _bytes(_truncate)),
    ("repeated in", _bytes(_repeat)),
    ("inserted into", _bytes(_insert)),
    ("lines moved in", _bytes(_lines)),
    ("number changed in", _bytes(_token(NUMBER, NUMBERS))),
    ("number changed in", _bytes(_token(NUMBER, NUMBERS))),
    ("word changed in", _bytes(_token(WORD, WORDS))),
    ("word changed in", _bytes(_token(WORD, WORDS))),
    ("nested in", _bytes(_nest)),
    ("indented before", _bytes(_indent)),
    ("encoded otherwise:", _bytes(_encoding)),
    ("value changed in", _bytes(_structure)),
    ("value changed in", _bytes(_structure)),
    ("array changed in", _archive),
    ("emptied:", _bytes(lambda data, rng: b"")),
    ("of another kind:", _swap),
    ("a folder:", _directory),
    ("a link:", _link),
    ("removed:", _remove),
    ("copied:", _copy),
)
