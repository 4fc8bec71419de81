import importlib
import sys

import pytest

STUB = """
from lazy_sample import inner
from lazy_sample.numbers import ONE, two

__all__ = ["ONE", "inner", "two"]
"""


@pytest.fixture
def sample(tmp_path, monkeypatch):
    package = tmp_path / "lazy_sample"
    package.mkdir()
    (package / "__init__.py").write_text(
        "from bt_jax._util.lazy import lazy_face\n__all__, __getattr__, __dir__ = lazy_face(__name__, __file__)\n"
    )
    (package / "__init__.pyi").write_text(STUB)
    (package / "numbers.py").write_text("ONE = 1\ndef two(): return 2\n")
    (package / "inner.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("lazy_sample")
    for name in [name for name in sys.modules if name.startswith("lazy_sample")]:
        del sys.modules[name]


def test_a_name_loads_its_module_when_it_is_used(sample):
    assert "lazy_sample.numbers" not in sys.modules
    assert sample.two() == 2
    assert sample.ONE is sys.modules["lazy_sample.numbers"].ONE
    assert "lazy_sample.inner" not in sys.modules
    assert sample.inner is sys.modules["lazy_sample.inner"]


def test_the_face_lists_its_names_before_they_are_loaded(sample):
    assert sample.__all__ == ["ONE", "inner", "two"]
    assert {"ONE", "inner", "two", "__name__"} <= set(dir(sample))
    assert "lazy_face" not in dir(sample)


def test_a_star_import_brings_exactly_the_public_names(sample):
    found = {}
    exec("from lazy_sample import *", found)
    assert set(found) - {"__builtins__"} == {"ONE", "inner", "two"}


def test_an_unknown_name_is_an_attribute_error(sample):
    with pytest.raises(AttributeError, match="'lazy_sample' has no attribute 'three'"):
        _ = sample.three
