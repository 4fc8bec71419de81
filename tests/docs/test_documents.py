"""Every command and every snippet of the documents runs, from an empty folder."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib

import pytest
import yaml

import bt_jax
from tests.helpers.documents import DOCUMENTS, ROOT, blocks, commands

MARKED = 14  # blocks that may not be run, in all documents: most need a robot, a camera, or minutes
SOLVED = {  # evolutions of documents that must find a tree that works
    "README.md": "runs/stack",
    "docs/quickstart.md": "runs/stack",
    "docs/tutorials/own_task.md": "runs/two_towers",
}
LANGUAGES = {"cpp", "python", "sh", "text", "xml", "yaml"}


def has_blocks_to_run(path) -> bool:
    found = blocks(path.read_text("utf-8"))
    return any(block.language in ("python", "sh") and not block.built for block in found)


RUNNABLE = [path for path in DOCUMENTS if has_blocks_to_run(path)]  # test_site.py runs those of the other pages


@pytest.mark.slow
@pytest.mark.parametrize("path", RUNNABLE, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_block_runs(path, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    words = [sys.executable, "-m", "tests.helpers.documents", str(path)]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    if run := SOLVED.get(str(path.relative_to(ROOT))):
        assert json.loads((tmp_path / run / "result.json").read_text("utf-8"))["success_rate"] > 0.5


def test_few_blocks_are_marked_as_not_run():
    marked = [block for path in DOCUMENTS for block in blocks(path.read_text("utf-8")) if block.skipped]
    assert len(marked) <= MARKED
    assert all("(" in block.marker for block in marked)


def test_blocks_name_a_language_that_says_whether_they_are_run():
    for path in DOCUMENTS:
        text = path.read_text("utf-8")
        found = blocks(text)
        assert {block.language for block in found} <= LANGUAGES, path
        assert text.count("\n```") == 2 * len(found), f"{path}: a block is indented, or has no language"


def test_the_readme_is_short_and_begins_with_the_two_commands():
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 150
    assert "python -m pip install -e . && python -m bt_jax.train stack" in text
    assert 'python -m pip install -e ".[app,test]" && python -m pytest' in text


def test_a_replacement_that_is_out_of_date_is_an_error():
    with pytest.raises(ValueError, match="not in the block"):
        blocks("<!-- test: s/--runs 10/--runs 1/ -->\n```sh\npython -m bt_jax.experiments\n```\n")


def test_commands_of_a_block(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run-1").mkdir()
    code = 'echo "a b"  # a comment\npython -m x run-* \\\n    --y && ls\n'
    assert list(commands(code)) == [["echo", "a b"], ["python", "-m", "x", "run-1", "--y"], ["ls"]]


def test_commands_within_a_sentence_name_modules():
    for path in DOCUMENTS:
        for module in re.findall(r"`python -m ([a-z_.]+)[ `]", path.read_text("utf-8")):
            assert importlib.util.find_spec(module) is not None, f"{path}: {module}"


def test_links_of_the_readme_lead_somewhere():
    targets = re.findall(r"\]\((?!http)([^)#]+)", (ROOT / "README.md").read_text("utf-8"))
    assert all((ROOT / target).exists() for target in targets), targets


def test_the_citation_names_this_version_and_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert (citation["version"], citation["license"]) == (bt_jax.__version__, project["license"])
    assert citation["references"][0]["authors"][0]["family-names"] == "Iovino"
