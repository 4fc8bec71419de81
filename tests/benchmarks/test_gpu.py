import json

import pytest

from benchmarks import gpu


def test_a_part_that_fails_says_why_and_keeps_its_rows(tmp_path):
    arguments = gpu.Arguments(sizes=(16,), trees=16)
    rows, reason = gpu.run_part(gpu.Part("profile", "metal", 1), arguments, tmp_path, 0)
    assert (rows, reason) == ([], "no time was left")
    rows, reason = gpu.run_part(gpu.Part("engine", "C", 1), arguments, tmp_path, 60)  # the trees were not made
    assert [row["way"] for row in rows] == ["C engine"]
    assert "FileNotFoundError" in reason


@pytest.mark.slow
def test_a_small_run_measures_every_part_that_can_be_here(tmp_path):
    gpu.main(gpu.Arguments(small=True, out=tmp_path / "gpu.json"))
    found = json.loads((tmp_path / "gpu.json").read_text())
    ways = [row["way"] for row in found["rows"]]
    assert {"C engine, table", "C engine, rollout", "MJX jax, table", "MJX jax, rollout"} <= set(ways)
    assert all((row["with chance, episodes/s"] or 0) > 0 for row in found["rows"] if "rollout" in row["way"])
    assert all(row["episodes/s"] > 0 and row["episodes"] == 16 for row in found["rows"])
    assert found["parity"][0]["same verdict"] > 0.9
    assert {"collision", "constraints", "solver"} <= {row["stage"] for row in found["profile"]}
    assert all("warp" in part or "accelerator" in reason for part, reason in found["failed"].items())
