"""The site is built without a warning, and a snippet that fails ends the build."""

import os
import subprocess
import sys

import pytest

from tests.helpers.documents import ROOT

pytest.importorskip("mkdocs", reason='the site needs pip install -e ".[docs]"')
CONCEPTS = sorted((ROOT / "docs" / "concepts").glob("*.md"))


def build(*arguments: object) -> subprocess.CompletedProcess:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", *map(str, arguments)]
    return subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_strict_build(tmp_path):
    done = build("--site-dir", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    for path in CONCEPTS:
        page = (tmp_path / "concepts" / path.stem / "index.html").read_text("utf-8")
        assert "Output" in page, f"{path} shows nothing that the build computes"


def test_a_snippet_that_fails_ends_the_build(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("# Page\n\n```python exec\nprint(1 / 0)\n```\n")
    config = tmp_path / "mkdocs.yml"
    config.write_text(f"site_name: test\nhooks: [{ROOT / 'docs' / 'hooks.py'}]\n")
    done = build("--config-file", config, "--site-dir", tmp_path / "site")
    assert done.returncode != 0
    assert "ZeroDivisionError" in done.stdout + done.stderr


def test_documents_and_pictures_are_small():
    for path in (ROOT / "docs").rglob("*"):
        assert path.is_dir() or path.stat().st_size < 1_000_000, path
