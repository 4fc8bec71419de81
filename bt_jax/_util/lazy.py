"""Package faces that load lazily: importing a package is free, and a public name loads its module when first used.

A face is two files. `__init__.pyi` imports the public names and lists them in `__all__`: type checkers and editors read it,
and so does this module. `__init__.py` holds the docstring and one line:

    __all__, __getattr__, __dir__ = lazy_face(__name__, __file__)

See PEP 562 (`__getattr__` of a module) and SPEC 1 (lazy loading from a stub).
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["lazy_face"]


def lazy_face(package: str, file: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a package, from the stub beside its `__init__.py`, which is `file`.

    The stub may use `from MODULE import NAME, ...` with absolute modules; `from PACKAGE import NAME` is a submodule.
    """
    modules: dict[str, str] = {}
    public: list[str] = []
    for statement in ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        match statement:
            case ast.ImportFrom(module=str(module), names=names):
                modules |= {alias.name: module for alias in names}
            case ast.Assign(targets=[ast.Name(id="__all__")], value=value):
                public = ast.literal_eval(value)

    def load(name: str) -> Any:
        module = modules.get(name)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        if module == package:
            return importlib.import_module(f"{package}.{name}")
        value = getattr(importlib.import_module(module), name)
        setattr(sys.modules[package], name, value)  # so that the next look-up does not come here
        return value

    def directory() -> list[str]:
        special = [name for name in vars(sys.modules[package]) if name.startswith("__")]
        return sorted({*special, *public})

    return public, load, directory
