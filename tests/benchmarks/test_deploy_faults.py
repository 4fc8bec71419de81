import pytest

from benchmarks.deploy_faults import faulty_program, rows
from bt_jax._util.errors import UserError
from bt_jax.tasks.faults import PRESETS, only


def test_a_fault_is_provoked_alone_or_with_those_of_its_file(tmp_path):
    tree, file = tmp_path / "tree.txt", tmp_path / "own.yaml"
    tree.write_text("pick(YellowBox)")
    file.write_text("slip: 0.3\nobjects: [GreenBox]\n")
    assert faulty_program(tree, "yumi_stack", "slip", "harsh").task.faults == only(PRESETS["harsh"], "slip")
    assert faulty_program(tree, "yumi_stack", str(file), "harsh").task.faults.objects == ("GreenBox",)
    file.write_text("slip: 0.3\nobjects: [RedBox]\n")
    with pytest.raises(UserError, match=r"own\.yaml.*there is no object 'RedBox'"):
        faulty_program(tree, "yumi_stack", str(file), "harsh")
    with pytest.raises(UserError, match="there are no faults 'wind'"):
        faulty_program(tree, "yumi_stack", "wind", "harsh")


def test_the_table_counts_runs_by_fault_and_tree():
    records = [
        {
            "fault": fault,
            "tree": tree,
            "solved": tree == "a" or layout < 2,
            "happened": "slip: YellowBox" * (layout > 4),
        }
        for fault in ("slip", "hide")
        for tree in ("a", "b")
        for layout in range(10)
    ]
    table = rows(records)
    assert [(row["fault"], row["tree"], row["solved"]) for row in table] == [
        ("hide", "a", 10), ("hide", "b", 2), ("slip", "a", 10), ("slip", "b", 2),
    ]  # fmt: skip
    assert {row["provoked"] for row in table} == {5}
    assert table[1]["95 %"] == "6 to 51 %"
