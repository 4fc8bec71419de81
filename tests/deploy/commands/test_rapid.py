"""The robot's program cannot be run here: what can be checked is that it is whole, and that it is what our side expects."""

import io
import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import REDUCED_SPEED, RapidArguments
from bt_jax.deploy.commands.rapid import rapid_command, rapid_module
from bt_jax.deploy.link import rws
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.rws import EGM_REQUEST, EGM_STATE, MODULE, TASKS, Motion, Rws, symbol
from bt_jax.deploy.link.settings import EGM_SPEED, LinkTiming, link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.tasks import load_task
from tests.helpers.cells import ARMS, RULES, cell, run_for, skipped_where_starved, smooth

CODE = "\n".join(re.sub(r'("[^"]*")|!.*', r"\1", line) for line in rapid_module().splitlines())  # without comments
STATEMENT = re.sub(r"\s+", " ", CODE)
BY_HAND = {"teach_ready", "go_ready", "calibrate_hand"}  # routines that a person runs
NUMBERS = [
    getattr(rws, name) for name in ["EGM_REQUEST", "EGM_STATE", "EGM_HERE", "GRIP_TARGET", "GRIP_FORCE", "GRIP_ACTUAL"]
]


def constant(name):
    return float(re.search(rf"CONST num {name}:=([^;]+);", CODE)[1])


def test_every_number_that_we_ask_for_is_there_for_each_arm():
    assert re.match(rf"\s*MODULE {MODULE}\s", CODE)
    for arm in ARMS:
        for name in NUMBERS:
            _, task, module, variable = symbol(arm, name).split("/")
            assert module == MODULE
            assert re.search(rf"^\s*TASK PERS num {variable}:=", CODE, re.MULTILINE), (
                "a PERS alone is shared by both arms"
            )
            assert task in TASKS.values()
    assert len(re.findall(r"\bPERS num\b", CODE)) == len(NUMBERS)
    assert "PERS" not in re.sub(r"\bTASK PERS\b", "", CODE), "a PERS alone is shared by both arms"


def test_the_values_of_the_motion_are_ours():
    assert {name: constant(name) for name in Motion.__members__} == {each.name: each for each in Motion}


def test_the_left_arm_is_told_by_its_task_and_each_has_a_device_of_its_own():
    setups = re.findall(r'EGMSetupUC ROB_ID,egm_id,"default","(\w+)"\\Joint', STATEMENT)
    assert setups == ["BtJax_L", "BtJax_R"]
    assert f'IF GetTaskName()="{TASKS["left"]}" THEN EGMSetupUC ROB_ID,egm_id,"default","BtJax_L"' in STATEMENT


def test_all_seven_axes_are_guided():
    for instruction, axis in [("EGMActJoint", r"\\J(\d):=NEAR"), ("EGMRunJoint", r"\\J(\d)")]:
        found = re.search(rf"{instruction} ([^;]+);", STATEMENT)[1]
        assert re.findall(axis, found) == list("1234567"), instruction
    assert constant("SAMPLE") == 1000 * CYCLE


def test_the_controller_limits_the_speed_but_not_below_ours():
    assert constant("MAX_SPEED") == pytest.approx(np.degrees(EGM_SPEED))
    assert np.degrees(REDUCED_SPEED) * 1.05 < constant("MAX_SPEED") < 1.5 * np.degrees(REDUCED_SPEED)


def test_we_hold_the_arms_until_guided_motion_has_ended():
    assert constant("PERIOD") + constant("RAMP") < LinkTiming().ramp < constant("SILENT")


def test_egm_is_set_up_in_order():
    followed = re.search(r"PROC follow_setpoints\(\)(.*?)ENDPROC", STATEMENT)[1]
    order = [
        followed.index(word) for word in ("connect_egm", "EGMActJoint", "EGMRunJoint", "GUIDED", "EGMStop", "EGMReset")
    ]
    assert order == sorted(order)
    connected = re.search(r"PROC connect_egm\(num silence\)(.*?)ENDPROC", STATEMENT)[1]
    assert connected.index("EGMReset") < connected.index("EGMGetId") < connected.index("EGMSetupUC")
    main = re.search(r"PROC main\(\)(.*?)ENDPROC", STATEMENT)[1]
    assert (
        main.index("LISTEN")
        < main.index("begin_at_ready")
        < main.index("tell_position")
        < main.index("follow_setpoints")
    )


def test_it_is_rapid(tmp_path):
    (tmp_path / "rapidchecker.toml").write_text("indentation_size = 4\n")
    (tmp_path / "BtJax.mod").write_text(rapid_module())
    command = [sys.executable, "-m", "rapidchecker", "BtJax.mod"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONUTF8": "1"})
    assert found.returncode == 0, found.stdout + found.stderr


def test_texts_are_no_longer_than_a_string_of_rapid():
    assert all(len(text) <= 80 for text in re.findall('"([^"]*)"', CODE))


def test_each_side_of_the_handshake_writes_its_own_number():
    """A request that comes while another is carried out would be overwritten by its answer."""
    assert re.findall(r"(?<!num )egm_request:=(\w+);", CODE) == ["LISTEN"], (
        "only to forget what was asked for before the start"
    )
    assert re.search(r"PROC main\(\) begin_here:=egm_here=1; egm_here:=0; egm_request:=LISTEN;", STATEMENT)
    assert len(re.findall(r"\begm_here\b", CODE)) == 3, (
        "a start away from the ready target is for once, whatever follows"
    )
    assert re.findall(r"(?<!num )egm_state:=(\w+);", CODE) == ["LISTEN", "LISTEN", "GUIDED", "LISTEN"]


def test_the_arm_begins_at_a_target_that_a_person_has_taught():
    begun = re.search(r"PROC begin_at_ready\(\)(.*?)ENDPROC", STATEMENT)[1]
    assert "WHILE NOT ready_taught OR joint_gap(here,ready)>AT_READY DO" in begun
    assert "Stop;" in begun
    motions = re.findall(r"MoveAbsJ ([^;]+);", CODE)
    assert motions == ["ready\\NoEOffs,v50,fine,gripper", "here\\NoEOffs,v10,fine,gripper"]
    assert re.search(
        r"PROC go_ready\(\) IF NOT ready_taught THEN TPWrite [^;]+; RETURN; ENDIF MoveAbsJ ready", STATEMENT
    )
    refusal = re.search(r"IF ready_taught THEN TPWrite ([^;]+); ELSE TPWrite ([^;]+); ENDIF Stop;", begun)
    assert "go_ready" in refusal[1]
    assert "teach_ready" in refusal[2]
    assert "go_ready" not in refusal[2], "there is nowhere to go yet"
    assert "TASK PERS jointtarget ready:=[[0,0,0,0,0,0],[0,9E9," in CODE, "the same module is loaded for both arms"
    assert re.search(r"PROC teach_ready\(\) ready:=CJointT\(\); ready_taught:=TRUE;", STATEMENT)


def test_every_routine_of_the_program_hands_its_errors_on_to_main():
    routines = dict(re.findall(r"PROC (\w+)\([^)]*\)(.*?)ENDPROC", STATEMENT))
    for name in routines.keys() - BY_HAND - {"main"}:
        assert routines[name].rstrip().endswith("RAISE;"), name
    assert re.search(r"ERROR .*Stop; $", routines["main"])


def test_the_controller_knows_what_the_arms_carry():
    for instruction in ("MoveAbsJ", "EGMActJoint"):
        assert all("gripper" in found for found in re.findall(rf"{instruction} [^;]+;", STATEMENT)), instruction
    served = re.search(r"PROC serve_hand\(\)(.*?)ENDPROC", STATEMENT)[1]
    assert re.search(r"Hand_GripInward[^;]+; GripLoad part; .*Hand_MoveTo[^;]+; GripLoad load0;", served)
    text = rapid_module(load_task("yumi_stack"), gripper_mass=0.248)
    assert "TASK PERS tooldata gripper:=[TRUE,[[0,0,0],[1,0,0,0]],[0.248,[" in text
    part = float(re.search(r"loaddata part:=\[([^,]+),", text)[1])
    assert part == pytest.approx(max(box.density * box.edge**3 for box in load_task("yumi_stack").objects), abs=1e-3)
    assert f"[{YUMI.arm('left').gripper.total_mass:g},[" in rapid_module()


def test_no_hand_moves_before_it_is_calibrated():
    prepared = re.search(r"PROC prepare_hand\(\)(.*?)ENDPROC", STATEMENT)[1]
    loop = re.search(r"WHILE NOT Hand_IsCalibrated\(\) DO (.*?) ENDWHILE (.*)", prepared)
    assert loop[1].endswith("Stop;")
    assert "PP to main" in loop[1]
    assert loop[2].startswith("Hand_Initialize")


def test_what_is_called_is_there():
    assert all(line.isascii() and len(line) <= 130 for line in rapid_module().splitlines())
    procedures = set(re.findall(r"PROC (\w+)\(", CODE)) - BY_HAND
    names = set(re.findall(r"(?:num|egm_minmax|egmident|jointtarget) (\w+)", CODE))
    statements = re.sub(r"\b(DO|THEN|ENDIF|ENDWHILE|ELSE)\b|\)", ";", STATEMENT).split(";")
    called = {words.split()[0] for words in statements if re.match(r" *[a-z]+(_[a-z]+)+( [\w]+)? *$", words)}
    assert called - names == procedures - {"main"}
    assert all(len(name) <= 32 for name in names | procedures)


def test_it_says_that_it_was_never_tried():
    assert "never run on a controller" in rapid_module()
    assert "never run on a controller" in re.sub(r"\s+", " ", RapidArguments.__doc__)


def test_the_command_writes_it_and_says_what_next(tmp_path):
    console = Console(file=io.StringIO(), width=200)
    assert rapid_command(RapidArguments(out=tmp_path / "new"), console) == 0
    written = (tmp_path / "new" / "BtJax.mod").read_bytes()
    assert written.replace(b"\r\n", b"\n").decode() == rapid_module(load_task("yumi_stack"))
    said = console.file.getvalue()
    for word in ("never run on a controller", "UDPUC", "6511", "6512", "T_ROB_L", "emergency stop"):
        assert word in said


@pytest.mark.parametrize(
    ("changes", "told"),
    [({"gripper_mass": mass}, "--gripper-mass") for mass in (math.nan, math.inf, -3.0, 0.0, 0.45)]
    + [({"task": "stack"}, "100 mm wide")],
)
def test_nothing_is_written_that_an_arm_cannot_take(tmp_path, changes, told):
    with pytest.raises(UserError, match=told):
        rapid_command(RapidArguments(out=tmp_path, **changes), Console(file=io.StringIO()))
    assert not list(tmp_path.iterdir())


def test_where_it_cannot_be_written_a_sentence_says_so(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        rapid_command(RapidArguments(out=tmp_path / "file"), Console(file=io.StringIO()))


@pytest.mark.parametrize("realtime", [pytest.param(True, marks=pytest.mark.realtime), False])
def test_a_program_that_runs_already_is_asked_to_follow(realtime):
    ports = free_ports(YUMI.arm_names)
    with Controller(cell(), ports=ports, realtime=realtime) as controller:
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        rws.start()
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)
        link = Irc5Link(config, RULES, controller)
        with skipped_where_starved(controller, link), link:
            run_for(link, 0.2)
            assert not any(link.arm(arm).running for arm in ARMS)
            assert rws.number(symbol("left", EGM_REQUEST)) == Motion.LISTEN
            link.start()
            assert [rws.number(symbol(arm, EGM_STATE)) for arm in ARMS] == [Motion.GUIDED] * 2
            start = link.arm("left").commanded
            link.follow("left", smooth(start, start + 0.1, 0.5))
            run_for(link, 1.0)
            assert link.stopped() is None
            np.testing.assert_allclose(link.arm("left").joints, start + 0.1, atol=5e-3)
