"""A kit to hand on as one file: a task, demonstrations and trees, in a zip with these names and no others:

kit.json                        {"format": 1, "version": that of the program that wrote it}
task.yaml                       the task, which extends no other
demonstrations/SET/...          info.yaml, task.yaml and DEMONSTRATION/data_K.yaml of a set, see `lfd.demonstration_folder`
trees/NAME.txt                  trees for the task

A file may come from anybody. It is read in memory: how many parts there are, how large each is and what it is called is
checked before it is unpacked, and what it says is read by the readers of the files that it is made of.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import io
import json
import re
import stat
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import is_name, write_atomic
from bt_jax._util.yaml_files import parse_yaml, to_yaml
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.files import check_tree
from bt_jax.encoding.formats.text import format_tree, parse_tree
from bt_jax.lfd import DemonstrationFolder
from bt_jax.tasks import Task, task_from_dict

__all__ = ["LARGEST", "SUFFIX", "KitFile", "read_set", "write_set"]

SUFFIX = ".kit.zip"
FORMAT = 1
LARGEST = 20_000_000  # bytes of a file
MOST_PARTS = 5000
LARGEST_PART = 2_000_000  # bytes, unpacked
LARGEST_WHOLE = 100_000_000  # bytes of all parts, unpacked
OF_SET = re.compile(r"(?:info|task)\.yaml|([^/]+)/data_[0-9]{1,6}\.yaml")
DATE = (1980, 1, 1, 0, 0, 0)  # of every part, so that equal kits are equal files

Files = Mapping[str, bytes]  # of a set of demonstrations, by their paths in its folder


@dataclasses.dataclass(frozen=True)
class KitFile:
    """A task, sets of demonstrations as their files, and trees, the last two by their names."""

    task: Task
    sets: Mapping[str, Files] = dataclasses.field(default_factory=dict)
    trees: Mapping[str, Tree] = dataclasses.field(default_factory=dict)

    def check(self) -> None:
        """Raise UserError for a name that is none, a tree that does not fit the task, or demonstrations that cannot be
        used."""
        for name in (*self.sets, *self.trees):
            if not is_name(name):
                raise UserError(f"'{name}' cannot name anything in a kit; rename it first")
        for name, tree in self.trees.items():
            check_tree(tree, self.task, f"the tree {name}")
        for name, files in self.sets.items():
            _check_set(name, files)

    def pack(self) -> bytes:
        """Return the file. Raise UserError as `check` does, or if it is too large to be read back."""
        self.check()
        head = {"format": FORMAT, "version": importlib.metadata.version("bt_jax")}
        parts = {"kit.json": json.dumps(head).encode(), "task.yaml": to_yaml(self.task.to_dict()).encode()}
        for name, files in self.sets.items():
            parts |= {f"demonstrations/{name}/{path}": data for path, data in files.items()}
        parts |= {f"trees/{name}.txt": format_tree(tree).encode() for name, tree in self.trees.items()}
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            _check_sizes({path: len(data) for path, data in parts.items()})
            for path, data in parts.items():
                archive.writestr(zipfile.ZipInfo(path, DATE), data, zipfile.ZIP_DEFLATED)
        return buffer.getvalue()

    @staticmethod
    def unpack(data: bytes, source: str) -> KitFile:
        """Return what is in a file. Raise UserError, naming `source`, if it is no kit, or one that cannot be trusted."""
        try:
            return _unpacked(data)
        except UserError as error:
            raise UserError(f"{source} cannot be opened: {error}") from error


def read_set(folder: DemonstrationFolder) -> Files:
    """Return the files of a set of demonstrations that make sense on another machine. Raise UserError if one cannot be
    read."""
    found: dict[str, bytes] = {}
    try:
        for path in sorted(folder.path.rglob("*.yaml")):
            name = path.relative_to(folder.path).as_posix()
            if _is_part_of_set(name) and not path.is_symlink():
                found[name] = path.read_bytes()
    except OSError as error:
        raise UserError(f"{folder.path} cannot be read ({error.strerror}); check who may read it") from None
    return _without_run(found)


def write_set(files: Files, path: Path) -> None:
    """Write a set of demonstrations into a new folder. Raise UserError if that fails."""
    for name, data in files.items():
        write_atomic(path / name, data)


@dataclasses.dataclass(frozen=True)
class _Head:
    format: int
    version: str


def _unpacked(data: bytes) -> KitFile:
    if len(data) > LARGEST:
        raise UserError(f"it is larger than {LARGEST // 1_000_000} MB; share fewer demonstrations")
    parts = _parts(data)
    if "kit.json" not in parts:
        raise UserError("it has no kit.json; choose a file that was saved as a kit")
    head = _head(parts.pop("kit.json"))
    if head.format != FORMAT:
        raise UserError(f"it has format {head.format} and this version reads {FORMAT}; use version {head.version}")
    if "task.yaml" not in parts:
        raise UserError("it has no task.yaml; ask for a whole one")
    task = task_from_dict(_own_task(parts.pop("task.yaml"), "task.yaml"), source="task.yaml", kept=True)
    sets: dict[str, dict[str, bytes]] = {}
    trees: dict[str, Tree] = {}
    for path, content in parts.items():
        room, _, rest = path.partition("/")
        if room == "demonstrations":
            name, _, rest = rest.partition("/")
            sets.setdefault(name, {})[rest] = content
        else:
            trees[rest.removesuffix(".txt")] = _tree(content, path)
    kit = KitFile(task, {name: _without_run(files) for name, files in sets.items()}, trees)
    kit.check()
    return kit


def _parts(data: bytes) -> dict[str, bytes]:
    """Return the parts of a zip by their names. Raise UserError for a name or size that is not allowed."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            infos = [info for info in archive.infolist() if not (info.is_dir() and info.file_size == 0)]
            _check_sizes({f"{number}": info.file_size for number, info in enumerate(infos)})
            for info in infos:
                if not _is_part(info.filename) or stat.S_ISLNK(info.external_attr >> 16):
                    raise UserError(f"it holds {info.filename[:80]!r}, which is no part of a kit; ask for another file")
            if len({info.filename.casefold() for info in infos}) < len(infos):
                raise UserError("it holds two parts of the same name; ask for another file")
            return {info.filename: archive.read(info) for info in infos}
    except UserError:
        raise
    except Exception as error:  # a damaged file may raise almost anything in zipfile and its decompressors
        raise UserError("it is no zip file, is damaged or has a password; ask for it again") from error


def _check_sizes(sizes: Mapping[str, int]) -> None:
    if len(sizes) > MOST_PARTS:
        raise UserError(f"it has {len(sizes):,} parts; share fewer demonstrations, for at most {MOST_PARTS:,}")
    if max(sizes.values(), default=0) > LARGEST_PART or sum(sizes.values()) > LARGEST_WHOLE:
        raise UserError(
            f"it holds more than {LARGEST_WHOLE // 1_000_000} MB, or a part of more than {LARGEST_PART // 1_000_000} MB; "
            "share less"
        )


def _is_part(path: str) -> bool:
    """Return whether a name stands for a part of a kit: nothing else is ever read, and nothing leads out of a folder."""
    room, _, rest = path.partition("/")
    if path in ("kit.json", "task.yaml"):
        return True
    if room == "trees":
        return rest.endswith(".txt") and is_name(rest.removesuffix(".txt"))
    name, _, inner = rest.partition("/")
    return room == "demonstrations" and is_name(name) and _is_part_of_set(inner)


def _is_part_of_set(path: str) -> bool:
    found = OF_SET.fullmatch(path)
    return found is not None and (found[1] is None or is_name(found[1]))


def _head(data: bytes) -> _Head:
    try:
        return decode(json.loads(data), _Head, "kit.json")
    except (ValueError, RecursionError):
        raise UserError("kit.json is damaged; ask for the file again") from None


def _own_task(data: bytes, path: str) -> Any:
    """Return what a task file says. Raise UserError if it extends another, which could be anywhere on this machine."""
    said = parse_yaml(_text(data, path), path)
    if isinstance(said, Mapping) and "extends" in said:
        raise UserError(f"{path} extends another task; a kit must say everything itself")
    return said


def _tree(data: bytes, path: str) -> Tree:
    try:
        return parse_tree(_text(data, path))
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def _text(data: bytes, path: str) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        raise UserError(f"{path} is no text in UTF-8; ask for the file again") from None


def _without_run(files: Files) -> Files:
    """Return the files of a set without the run that went before, which is a path on the machine where it was recorded."""
    said = parse_yaml(_text(files["info.yaml"], "info.yaml"), "info.yaml") if "info.yaml" in files else None
    if not isinstance(said, Mapping) or "after" not in said:
        return files
    return {**files, "info.yaml": to_yaml({key: value for key, value in said.items() if key != "after"}).encode()}


def _check_set(name: str, files: Files) -> None:
    """Raise UserError unless a set can be used as a whole."""
    if "task.yaml" in files:
        task_from_dict(_own_task(files["task.yaml"], "task.yaml"), source=f"{name}/task.yaml", kept=True)
    if "info.yaml" not in files:
        raise UserError(f"the demonstrations {name} have no info.yaml; record them again, or leave them out")
    with tempfile.TemporaryDirectory(prefix="bt_jax-") as scratch:
        folder = DemonstrationFolder(Path(scratch) / name)
        try:
            write_set(files, folder.path)
            problems = folder.read().problems
        except UserError as error:
            raise UserError(str(error).replace(f"{scratch}/", "")) from error
        if problems:
            raise UserError(problems[0].replace(f"{scratch}/", "").removesuffix("."))
