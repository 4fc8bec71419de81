"""The scene takes three.js from private files of NiceGUI: this says what is missing after an update of NiceGUI."""

import inspect
import re
import tomllib
from pathlib import Path

import nicegui
from nicegui.element import Element

from bt_jax.app.widgets.scene_view import PARTS, THREE

ROOT = Path(__file__).parents[3]


def exported(script):
    """The names that a bundled module exports."""
    (names,) = re.findall(r"export\s*\{([^}]*)\}", script)
    return {name.split(" as ")[-1].strip() for name in names.split(",")}


def test_nicegui_still_brings_three_js():
    where = (
        f"NiceGUI {nicegui.__version__} has no {THREE / 'index.js'}; widgets/scene_view.py takes three.js from there"
    )
    assert (THREE / "index.js").is_file(), where
    missing = {"OrbitControls", "THREE"} - exported((THREE / "index.js").read_text(encoding="utf-8"))
    assert not missing, f"NiceGUI {nicegui.__version__} does not export {missing}; static/scene.js imports them"


def test_components_may_still_bring_modules_of_their_own():
    options = inspect.signature(Element.__init_subclass__).parameters
    assert {"component", "esm"} <= set(options), "NiceGUI's Element no longer takes component and esm"


def test_a_version_of_nicegui_that_was_not_tried_is_not_installed():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (requirement,) = project["optional-dependencies"]["app"]
    assert re.fullmatch(r"nicegui>=[\d.]+,<[\d.]+", requirement)


def test_every_part_of_the_scene_that_is_imported_is_there():
    for script in (PARTS.parent / "scene.js", *PARTS.glob("*.js")):
        text = script.read_text(encoding="utf-8")
        for name in re.findall(r'from "(?:bt_jax-scene|\.)/(.*?)"', text):
            assert (PARTS / name).is_file(), f"{script.name} imports {name}"
        for names, name in re.findall(r'import \{ (.*?) \} from "(?:bt_jax-scene|\.)/(.*?)"', text):
            for wanted in names.split(", "):
                assert re.search(rf"export (function|const) {wanted}\b", (PARTS / name).read_text(encoding="utf-8"))
