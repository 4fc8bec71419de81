"""Scripted demonstrations, and what is learnt from them on the command line."""

import dataclasses
import json
import shlex

import pytest

from bt_jax import demonstrate
from bt_jax import learn as learn_command
from bt_jax._util.errors import UserError
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder, Demonstrations, Frames, learn, plan_task
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.tasks import load_task, task_of_folder
from bt_jax.teaching.script import Input, parse_script, record, record_one
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.samples import command

TASK = load_task("stack3")
SCRIPT = "pick BlueBox; to (0, 0, 0.11) GreenBox; release"


def test_scripts_are_read():
    text = "pick BlueBox\n# over the other\nto (0, 0.5, .1) GreenBox; move (1, 0, -1e-2)   # a bit\nrelease"
    assert parse_script(text) == [
        Input("pick", "BlueBox"),
        Input("to", "GreenBox", (0.0, 0.5, 0.1)),
        Input("move", "", (1.0, 0.0, -0.01)),
        Input("release"),
    ]


@pytest.mark.parametrize(
    "text", ["", "# nothing", "grab BlueBox", "to (0, 0) GreenBox", "move (0, 0, x)", "pick", "to GreenBox"]
)
def test_invalid_scripts(text):
    with pytest.raises(UserError, match="write"):
        parse_script(text)


def test_scripts_come_from_any_editor():
    text = "\ufeffpick BlueBox  # take it; then\r\nto (0,\u00a00, \u22120.1) GreenBox;release # done; really"
    assert parse_script(text) == [Input("pick", "BlueBox"), Input("to", "GreenBox", (0.0, 0.0, -0.1)), Input("release")]


EDGE = "pick BlueBox; to (0.25, 0, 0) GreenBox; release"  # in some layouts the box falls beside the table


def demonstrated(capsys, *words):
    """What the command says on stderr, and its exit code."""
    with pytest.raises(SystemExit) as end:
        demonstrate.main(list(map(str, words)))
    return capsys.readouterr().err, end.value.code


def test_a_layout_in_which_a_script_fails_costs_only_itself(tmp_path, capsys):
    said, code = demonstrated(capsys, tmp_path / "demos", EDGE, "--count", 6)
    assert code == 2
    kept = "error: 4 of 6 demonstrations are kept; the script fails in the layouts 0, 5, first in layout 0: "
    assert said.startswith(kept)
    assert "BlueBox would fall to the floor" in said
    said, _ = demonstrated(capsys, tmp_path / "others", EDGE, "--count", 2)
    assert said.startswith("error: 1 of 2 demonstrations is kept; the script fails in layout 0: ")
    folder = DemonstrationFolder(tmp_path / "demos")
    assert folder.names() == [one.name for one in folder.read()] == ["demo1", "demo2", "demo3", "demo4"]


@pytest.mark.parametrize("lost", [False, True], ids=["info.yaml", "info.yaml lost"])
def test_no_layout_is_recorded_twice(tmp_path, capsys, lost):
    """Neither after layouts in which a script failed, nor after a demonstration was deleted."""
    folder = DemonstrationFolder(tmp_path / "demos")
    demonstrated(capsys, folder.path, EDGE if not lost else SCRIPT, "--count", 6 if not lost else 3)
    demonstrated(capsys, folder.path, "--delete", "demo1")
    if lost:
        (folder.path / "info.yaml").unlink()
    assert demonstrated(capsys, folder.path, SCRIPT if lost else EDGE, "--count", 2)[1] in (0, 2)
    shown = list(folder.read())
    assert len(shown) > 2
    assert len({one.actions[0].poses["base_link"] for one in shown}) == len(shown)
    assert folder.next_layout() == (5 if lost else 8)


def test_demonstrations_that_are_whole_are_kept_when_somebody_presses_ctrl_c(tmp_path, capsys, monkeypatch):
    def interrupted(task, physics, script, number, **options):
        if number == 2:
            raise KeyboardInterrupt
        return record_one(task, physics, script, number, **options)

    monkeypatch.setattr("bt_jax.commands.demonstrate.record_one", interrupted)
    assert demonstrated(capsys, tmp_path / "demos", SCRIPT, "--count", 20) == ("stopped\n", 130)
    assert [one.name for one in DemonstrationFolder(tmp_path / "demos").read()] == ["demo1", "demo2"]


def test_a_script_is_read_from_an_existing_file_whatever_its_name(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("my script.txt", "pick BlueBox", "größer; 箱.txt"):
        (tmp_path / name).write_text(SCRIPT, encoding="utf-8-sig")
        assert demonstrated(capsys, f"demos of {name}", name, "--count", 1) == ("", 0)
    said, code = demonstrated(capsys, "demos", "your script.txt")
    assert (said, code) == ("error: there is no file your script.txt; check the path\n", 2)


def test_the_lesson_is_what_was_scripted():
    task = load_task("stack")
    recorded = record(TASK, Kinematic(TASK), parse_script(SCRIPT), noise=0.003, after=plan_task(task))
    lesson = learn(Demonstrations(Frames.of(TASK), tuple(recorded)), TASK)
    assert lesson.tree.name == "move"
    assert lesson.tree.object == "BlueBox"
    # Box, box and kit stand in each other's frames as they always do there: any of them says the same.
    height = {"GreenBox": 0.11, "YellowBox": 0.21, "KittingBox": 0.2625}[lesson.tree.frame]
    assert lesson.tree.position == pytest.approx((0, 0, height), abs=0.008)
    assert lesson.missing == 0


def test_from_the_script_to_the_tree(tmp_path):
    folder, out = tmp_path / "demonstrations", tmp_path / "lesson"
    done = command("bt_jax.demonstrate", folder, SCRIPT, "--count", 2)
    assert done.returncode == 0, done.stderr
    assert "2 of 3 demonstrations" in done.stdout
    done = command("bt_jax.demonstrate", folder, SCRIPT, "--count", 1, "--seed", 5)
    assert done.returncode == 0, done.stderr
    assert DemonstrationFolder(folder).names() == ["demo1", "demo2", "demo3"]
    done = command("bt_jax.learn", folder, "--out", out, "--level", "kinematic", "--layouts", 5)
    assert done.returncode == 0, done.stderr
    assert "5 of 5" in done.stdout
    assert "place BlueBox at (0, 0, 0.11) in GreenBox" in done.stdout
    tree = parse_tree((out / "learnt_tree.txt").read_text())
    assert tree == from_xml((out / "learnt_tree.xml").read_text())
    assert str(tree) == "move(BlueBox, (0, 0, 0.11), GreenBox)"
    assert "<svg" in (out / "learnt_tree.svg").read_text()
    assert (out / "clusters.png").read_bytes().startswith(b"\x89PNG")
    data = json.loads((out / "lesson.json").read_text())
    assert (data["tree"], data["solved"], data["missing"]) == (str(tree), 5, 0)


def test_demonstrations_remember_a_task_of_ones_own(tmp_path):
    """And the command that `demonstrate` names next works as it stands."""
    mine = dataclasses.replace(TASK, name="mine", description="")
    run = RunFolder.create(tmp_path / "run", RunConfig(mine, GPConfig(), Settings()))
    run.save_tree(parse_tree("move(YellowBox, (0, 0, 0.052), KittingBox)"), title="")
    shown, script = tmp_path / "shown here", tmp_path / "my script.txt"
    script.write_text(SCRIPT)
    done = command("bt_jax.demonstrate", shown, script, "--count", 1, "--after", run.path)
    assert done.returncode == 0, done.stderr
    assert task_of_folder(shown) == mine
    words = shlex.split(done.stdout.split("python -m ")[1])
    assert words == ["bt_jax.learn", str(shown)]
    done = command(*words, "--level", "kinematic", "--layouts", 1, "--out", tmp_path / "learnt")
    assert done.returncode == 0, done.stderr
    assert task_of_folder(tmp_path / "learnt") == mine
    assert "0 of 1" in done.stdout
    assert f"bt_jax.train --resume {run.path} --add-target-from '{shown}'" in done.stdout


def test_demonstrations_are_kept_and_frames_chosen_on_the_command_line(tmp_path):
    folder = DemonstrationFolder(tmp_path / "shown")
    folder.create(Frames.of(TASK))
    for one in record(TASK, Kinematic(TASK), parse_script(SCRIPT), noise=0.003):
        folder.append(one)
    done = command("bt_jax.demonstrate", folder.path, "--rename", "demo1", "the first", "--delete", "demo2")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["the first: 2 actions, moves BlueBox", "demo3: 2 actions, moves BlueBox"]
    options = ("--level", "kinematic", "--layouts", 2, "--out")
    done = command("bt_jax.learn", folder.path, "--frames", "2=GreenBox", "3=GreenBox", *options, tmp_path / "a")
    assert done.returncode == 0, done.stderr
    assert "chosen by hand" in done.stdout
    assert "2 of 2" in done.stdout
    assert learn(folder.read(), TASK).targets[0].frame == "GreenBox"  # kept with the demonstrations
    for option, bad, remedy in [
        ("--frames", "9=auto", "choose one from 1 to 2"),
        ("--frames", "2=PinkBox", "choose KittingBox"),
        ("--frames", "x", "write ACTION=FRAME"),
        ("--answers", "1=1", "nothing is open; leave out --answers"),
        ("--take-back", "2", "there is no answer 2 to take back"),
    ]:
        done = command("bt_jax.learn", folder.path, option, bad, *options, tmp_path / "b")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert remedy in done.stderr
    done = command("bt_jax.learn", folder.path, "--frames", "2=auto", *options, tmp_path / "b")
    assert done.returncode == 0, done.stderr
    assert {place.frame for place in learn(folder.read(), TASK).placements} == {"base_link"}


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("bt_jax.learn", "nowhere"), "give one with demonstrations"),
        (("bt_jax.demonstrate", "new", "jump"), "write pick OBJECT"),
        (("bt_jax.demonstrate", "new", "pick RedBox; release"), "use one of YellowBox"),
        (("bt_jax.demonstrate", "new"), "there is no folder new"),
        (("bt_jax.demonstrate", "new", "--delete", "demo1"), "there is no folder new"),
        (("bt_jax.demonstrate", "new", SCRIPT, "--delete", "demo1"), "leave out the script"),
        (("bt_jax.demonstrate", "new", "pick BlueBox; to (0, 0, 0) GreenBox; release"), "would be inside GreenBox"),
        (("bt_jax.demonstrate", "new", "pick BlueBox"), "release it, then finish"),
        (("bt_jax.demonstrate", "new", SCRIPT, "--count", 0), "choose 1 or more"),
        (("bt_jax.demonstrate", "new", SCRIPT, "--after", "nowhere.txt"), "give a run folder, or a tree"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(tmp_path, arguments, remedy):
    done = command(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert remedy in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["stack3", "restack"], ids=["no subgoals", "a subgoal"])
def test_the_next_command_means_the_task_of_the_lesson(tmp_path, capsys, name):
    """Also where a task was kept before it said when a subgoal counts as reached."""
    task = load_task(name)
    folder, out = DemonstrationFolder(tmp_path / "shown"), tmp_path / "lesson"
    folder.create(Frames.of(task))
    folder.append(record_one(TASK, Kinematic(TASK), parse_script(SCRIPT), 0))
    older = task.to_dict()
    del older["subgoal_reward"]
    (folder.path / "task.yaml").write_text(json.dumps(older))
    with pytest.raises(SystemExit) as end:
        learn_command.main([str(folder.path), "--level", "kinematic", "--layouts", "1", "--out", str(out)])
    assert not end.value.code
    words = shlex.split(capsys.readouterr().out.split("python -m bt_jax.train ")[1])
    if name == "stack3":
        assert words[0] == "stack3"
    else:
        assert words[:2] == ["--task", str(out / "task.yaml")]
        assert load_task(words[1]) == task_of_folder(folder.path)
