"""What a survey takes from its file, and what it does again."""

import dataclasses
import json

from benchmarks._survey import accumulated, code_digest, digest_of, stored
from bt_jax.tasks import load_task


@dataclasses.dataclass(frozen=True)
class Job:
    seed: int
    code: str


def double(job):
    return {"twice": 2 * job.seed}


def never(job):
    raise AssertionError("it is in the file already")


def test_a_survey_goes_on_with_the_records_of_its_own_code_only(tmp_path):
    path = tmp_path / "results" / "survey.json"
    path.parent.mkdir()
    path.write_text(json.dumps({"runs": [{"seed": 1, "twice": 5}, {"seed": 1, "code": "old", "twice": 6}]}))
    new = [Job(1, "new"), Job(2, "new")]
    found = sorted(accumulated(path, new, double, 1), key=lambda record: record["seed"])
    assert found == [{"seed": 1, "code": "new", "twice": 2}, {"seed": 2, "code": "new", "twice": 4}]
    assert list(accumulated(path, new, never, 1)) == found
    assert len(stored(path)) == 4
    assert stored(path, code="old") == [{"seed": 1, "code": "old", "twice": 6}]


def test_digests_tell_tasks_and_code_apart(tmp_path):
    stack = load_task("yumi_stack")
    assert digest_of(stack) != digest_of(dataclasses.replace(stack, targets=stack.targets[:1]))
    (tmp_path / "more.py").write_text("1")
    assert code_digest() == code_digest() != code_digest(tmp_path / "more.py")
