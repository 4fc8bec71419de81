"""Leaves out what cannot run here: everything without NiceGUI, and the tests in a browser without one to drive."""

import importlib.util
import shutil

import pytest

CHROMIUM = next((name for name in ("chromium", "chromium-browser", "google-chrome") if shutil.which(name)), None)
MISSING = [name for name in ("nicegui", "playwright") if importlib.util.find_spec(name) is None]
if CHROMIUM is None:
    MISSING.append("chromium")
collect_ignore_glob = ["*.py"] if "nicegui" in MISSING else ["browser/*.py"] if MISSING else []


def pytest_report_header() -> str | None:
    what = "tests/app" if "nicegui" in MISSING else "tests/app/browser"
    remedy = "pip install -e '.[app,test]', and chromium from your distribution"
    return f"{what} left out, {', '.join(MISSING)} missing: {remedy}" if MISSING else None


class Clock:
    """A clock that the test sets, seconds."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()
