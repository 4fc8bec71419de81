import io

import numpy as np
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import Behavior
from bt_jax.deploy.commands.display import RunDisplay, sight_table
from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
PICK = Behavior("pick", ("YellowBox",))
POSE = RigidTransform.from_components([0.3, 0.24, 0.02], Rotation.from_euler("z", np.radians(12)))
TWICE = Finding("GreenBox", "GreenBox's marker is seen twice", stops=True)
SOFT = Finding("", "the picture is too soft")


def seen(time=10.0, findings=()):
    measured = {"YellowBox": time - 0.1, "GreenBox": time - 3.2}
    return Observation(time, {"YellowBox": POSE}, {}, "BlueBox", findings=findings, measured=measured)


def printed(*things):
    console = Console(file=io.StringIO(), width=120)
    console.print(*things)
    return console.file.getvalue()


def test_objects_are_shown_with_pose_and_age_and_what_is_unknown_with_its_reason():
    lines = printed(sight_table(TASK, seen(findings=(TWICE, SOFT)))).splitlines()
    rows = {line.split()[0]: line.split() for line in lines}
    assert rows["YellowBox"] == ["YellowBox", "300", "240", "20", "12", "deg", "0.1", "s", "ago"]
    assert rows["GreenBox"][1:4] == ["3.2", "s", "ago"]
    assert "seen twice" in " ".join(rows["GreenBox"])
    assert rows["BlueBox"] == ["BlueBox", "never", "in", "the", "hand"]
    assert rows["KittingBox"] == ["KittingBox", "never", "unknown"]
    assert "too soft" in " ".join(rows["picture"])


def test_without_a_terminal_each_change_is_a_line():
    console = Console(file=io.StringIO(), width=120)
    with RunDisplay(Program(TASK, PICK), console) as display:
        for time, findings in ((10.0, ()), (10.1, (TWICE,)), (10.2, (TWICE,)), (10.3, ()), (10.4, (TWICE,))):
            display.update(TickReport(seen(time, findings), None, PICK, "acting"))
    lines = console.file.getvalue().splitlines()
    assert [line for line in lines if "acting" in line] == ["    0.0 s  acting pick(YellowBox)"]
    assert [line.split()[0] for line in lines if "twice" in line] == ["0.1", "0.4"]
    assert [line for line in lines if "KittingBox" in line] == ["    0.0 s  KittingBox is not seen"]
