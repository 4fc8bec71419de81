"""Damaged files of every kind are read, or refused in one sentence. `python -m benchmarks.fuzz` tries ten times as many."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

if not all(map(importlib.util.find_spec, ("cv2", "google.protobuf", "httpx", "pinocchio"))):
    pytest.skip("what the robot needs is not installed", allow_module_level=True)

from benchmarks import fuzz
from benchmarks._fuzz_inputs import KINDS

HALVES = (tuple(KINDS)[::2], tuple(KINDS)[1::2])


def test_every_kind_is_tried():
    assert set(HALVES[0]) | set(HALVES[1]) == set(KINDS)


@pytest.mark.parametrize(
    ("mutants", "processes", "kinds"),
    [
        (1000, 0, HALVES[0]),
        (1000, 0, HALVES[1]),
        pytest.param(1, 10, tuple(KINDS), marks=pytest.mark.slow),
    ],
)
def test_mutants_are_read_or_refused(mutants, processes, kinds, tmp_path):
    """In a process of its own, where nothing checks types and what is compiled is kept."""
    words = ["--mutants", str(mutants), "--processes", str(processes), "--out", str(tmp_path / "fuzz.json")]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.fuzz", *words, "--kinds", *kinds],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        timeout=1800,
    )
    assert (tmp_path / "fuzz.json").is_file(), done.stderr
    assert json.loads((tmp_path / "fuzz.json").read_text())["faults"] == []
    assert done.returncode == 0


def test_a_mutant_is_the_same_at_every_call(tmp_path):
    inputs = fuzz.prepare("calibration", tmp_path)
    first, again, other = (fuzz.tried("calibration", number, inputs) for number in (3, 3, 4))
    assert (first.damage, first.refused, first.fault) == (again.damage, again.refused, again.fault)
    assert first.damage != other.damage


@pytest.mark.parametrize(
    ("outcome", "fault"),
    [
        ((2, "error: a.yaml is empty; write it\n"), ""),
        ((0, "warning: something\n"), ""),
        ((2, ""), "0 lines"),
        ((2, "error: one\nerror: two\n"), "2 lines"),
        ((2, "usage: no\n"), "1 lines"),
        ((2, f"error: {'x' * 2000}"), "a sentence of 2,007 characters"),
        ((2, "error: \x1b[31m"), "unprintable"),
        ((1, "Traceback (most recent call last):\nValueError: x"), "traceback: ValueError: x"),
        ((139, ""), "exit code 139"),
    ],
)
def test_what_counts_as_a_fault(outcome, fault):
    found = fuzz.judged(*outcome, changed=False, slow=False)
    assert found.startswith(fault) if fault else found == ""
    assert "took too long" in fuzz.judged(0, "", changed=False, slow=True)
    assert "written" in fuzz.judged(2, "error: a; b", changed=True, slow=False)
