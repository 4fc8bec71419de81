"""The state of the robot's twin on the page, with a process that says what the test wants."""

import asyncio

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes.twin_messages import (
    Check,
    Ended,
    Failed,
    Item,
    Person,
    Picture,
    Replay,
    Run,
    Said,
    Show,
    Tick,
)
from bt_jax.app.processes.twin_process import TwinProcess
from bt_jax.app.state.robot_twin import RobotTwin
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.program import Program
from bt_jax.encoding.formats.text import format_tree, parse_tree
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.ideal import STACK3, IdealCell

TREE = parse_tree("Sequence\n  gripper(open)\n  pick(YellowBox)")


class Told(TwinProcess):
    """A process that keeps what it is told, and says what the test puts into `says`."""

    def __init__(self, job):
        self.job, self.told, self.says, self.ended, self.interrupted = job, [], [], False, 0

    @property
    def alive(self):
        return not self.ended

    def tell(self, message):
        self.told.append(message)

    def interrupt(self):
        self.interrupted += 1

    def take(self):
        said, self.says = self.says, []
        return said

    def close(self):
        self.ended = True

    kill = close

    def last_words(self):
        return "out of memory"


@pytest.fixture
def studio(tmp_path):
    return Studio(Workspace(tmp_path), load_task("yumi_stack"))


@pytest.fixture
def launched():
    return []


@pytest.fixture
def robot(studio, launched):
    def launch(job):
        launched.append(Told(job))
        return launched[-1]

    return RobotTwin(studio.bus, studio.worker, studio.workspace, studio.edited, studio.playing, launch)


def tick(statuses="212", **changes):
    return Tick(
        **{
            **{"time": 1.0, "statuses": statuses, "phase": "acting", "action": None, "holding": None},
            **{"doubts": [], "away": [], "ages": {}},
            **changes,
        }
    )


def hear(robot, process, *messages, ends=False):
    process.says += messages
    process.ended = ends
    robot.poll()


def test_a_tree_runs_is_disturbed_and_stopped(studio, robot, launched):
    with pytest.raises(UserError, match="there is no tree yet: find one in step 2, or choose one in step 6"):
        robot.start()
    studio.take_tree(TREE, None)
    assert robot.refusal == ""
    robot.start()
    (process,) = launched
    assert isinstance(process.job, Run)
    assert process.job.tree == format_tree(TREE)
    assert process.job.task == studio.edited.task.to_dict()
    assert robot.stage == "starting"
    with pytest.raises(UserError, match="the robot's twin runs; stop it first"):
        robot.start()
    with pytest.raises(UserError, match="nothing moves on the robot's twin; press Start first"):
        robot.disturb(Person("push", "YellowBox"))
    hear(robot, process, tick("212"), Picture("camera", b"1"), Picture("camera", b"2"), Said("refused", refused=True))
    assert robot.stage == "running"
    assert list(robot.statuses.values()) == [Status.RUNNING, Status.SUCCESS, Status.RUNNING]
    hear(robot, process, tick(None))
    assert list(robot.statuses.values()) == [Status.RUNNING, Status.SUCCESS, Status.RUNNING]
    assert (robot.pictures, robot.numbers) == ({"camera": b"2"}, {"camera": 2})
    assert robot.said.text == "refused"
    robot.disturb(Person("push", "YellowBox"))
    assert process.told == [Person("push", "YellowBox")]
    robot.stop()
    assert (process.interrupted, robot.stage) == (1, "stopping")
    hear(robot, process, tick(), Ended("interrupted", 2.0, solved=False, interrupted=True), ends=True)
    assert robot.ended.interrupted
    assert not robot.running
    with pytest.raises(UserError, match="nothing runs on the robot's twin"):
        robot.stop()


def test_another_start_is_from_other_places_and_has_a_log_of_its_own(studio, robot, launched):
    studio.take_tree(TREE, None)
    for elsewhere in (False, False, True):
        robot.start(elsewhere=elsewhere)
        (studio.workspace.root / "logs").mkdir(exist_ok=True)
        log = launched[-1].job.log
        with open(log, "x"):
            hear(robot, launched[-1], Ended("", 1.0, solved=True, interrupted=False), ends=True)
    assert [process.job.seed for process in launched] == [0, 0, 1]
    assert len({process.job.log for process in launched}) == 3


def test_changes_are_announced_and_a_process_that_says_nothing_changes_nothing(studio, robot, launched):
    told = []
    studio.bus.subscribe("robot", lambda: told.append(robot.stage))
    studio.take_tree(TREE, None)
    robot.start()
    robot.poll()
    assert told == ["starting"]
    hear(robot, launched[0], tick())
    assert told == ["starting", "running"]


def test_what_goes_wrong_is_said_with_a_remedy(studio, robot, launched):
    studio.take_tree(TREE, None)
    robot.start()
    hear(robot, launched[0], Failed("pictures cannot be drawn here; install libegl1"), ends=True)
    assert robot.failure == "pictures cannot be drawn here; install libegl1"
    assert not robot.running
    robot.start()
    assert robot.failure == ""
    hear(robot, launched[1], ends=True)
    assert robot.failure == "the robot's twin has ended unexpectedly (out of memory); start it again"


def test_a_task_that_the_robot_cannot_hold_is_refused_and_one_at_its_scale_is_offered(studio, robot):
    studio.open_task(load_task("kit4"))
    studio.take_tree(TREE, None)
    assert "mm wide, and the grippers of yumi open 50 mm" in robot.refusal
    assert robot.alternative == "yumi_kit4"
    studio.open_task(load_task("mobile_stack"))
    assert "drives" in robot.refusal
    assert robot.alternative == "yumi_stack"
    studio.open_task(load_task("yumi_kit4"))
    assert robot.alternative == ""


def test_what_is_not_installed_is_said_first(studio, robot, monkeypatch):
    monkeypatch.setattr("bt_jax.app.state.robot_twin._missing", lambda: ("pinocchio",))
    studio.open_task(load_task("kit4"))
    assert robot.refusal == (
        'What the robot\'s twin needs is not installed (pinocchio): run pip install -e ".[robot]" in a terminal and start '
        "the page again."
    )
    assert robot.alternative == ""
    with pytest.raises(UserError, match="what the robot's twin needs is not installed"):
        robot.check()


def logged(workspace, name):
    workspace.logs.mkdir(exist_ok=True)
    with Log(workspace.logs / f"{name}.jsonl") as log:
        IdealCell(log=log).executor.run()


def test_the_preflight_takes_the_log_of_the_same_tree(studio, robot, launched):
    logged(studio.workspace, "stacked")
    task = load_task("stack3")
    found = robot.twin_log(Program(task, STACK3))
    assert found == studio.workspace.logs / "stacked.jsonl"
    assert robot.twin_log(Program(task, TREE)) is None
    studio.take_tree(TREE, None)
    robot.check()
    assert isinstance(launched[0].job, Check)
    assert robot.log is None
    assert launched[0].job.twin_log is None
    hear(robot, launched[0], Item("tree", True, "3 leaves"))
    assert robot.checking
    hear(robot, launched[0], Item("camera", False, "give one"), ends=True)
    assert not robot.checking
    assert [item.name for item in robot.items] == ["tree", "camera"]


def test_a_log_is_looked_back_at_moment_by_moment(studio, robot, launched):
    logged(studio.workspace, "stacked")
    (studio.workspace.logs / "broken.jsonl").write_text("no log")
    with pytest.raises(UserError, match="is no log"):
        asyncio.run(robot.look_back("broken"))
    with pytest.raises(UserError, match="the log gone is no longer there; choose another"):
        asyncio.run(robot.look_back("gone"))
    with pytest.raises(UserError, match="no run is open"):
        robot.seek(1)
    asyncio.run(robot.look_back("stacked"))
    (process,) = launched
    assert process.job == Replay(str((studio.workspace.logs / "stacked.jsonl").resolve()))
    robot.seek(5)
    robot.seek(10**6)
    last = len(robot.record.moments) - 1
    assert process.told == [Show(0), Show(5), Show(last)]
    assert robot.at == last
    hear(robot, process, ends=True)
    robot.seek(2)
    assert launched[1].told == [Show(2)]  # it draws again after it has died
    studio.take_tree(TREE, None)
    robot.start()
    assert launched[1].ended
    assert robot.record is None
    with pytest.raises(UserError, match="stop it first"):
        asyncio.run(robot.look_back("stacked"))


def test_the_process_ends_with_the_page(studio, robot, launched):
    robot.close()
    studio.take_tree(TREE, None)
    robot.start()
    robot.close()
    assert launched[0].ended
