import dataclasses
import io
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.commands.arguments import RunArguments as Arguments
from bt_jax.commands.run import run
from bt_jax.deploy.commands.arguments import TwinArguments
from bt_jax.deploy.execution.program import load_program
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.render.offscreen import available
from bt_jax.run import main
from bt_jax.tasks import load_faults, load_task, with_faults
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

STACK = "Sequence\n  move(YellowBox, (0, 0, 0.055), KittingBox)\n  move(GreenBox, (0, 0, 0.1), YellowBox)\n"
HALF = "Sequence\n  pick(YellowBox)\n  open_gripper\n"


@pytest.fixture
def stack(tmp_path):
    path = tmp_path / "stack.txt"
    path.write_text(STACK)
    return path


def shown(terminal=False, **arguments):
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, highlight=False, soft_wrap=True, width=120, height=60)
    run(Arguments(**{"level": "kinematic", **arguments}), console)
    return out.getvalue()


@pytest.mark.parametrize("level", ["kinematic", "physics"])
def test_verbose_shows_the_tree_at_every_tick(stack, level):
    text = shown(source=stack, level=level, verbose=True)
    blocks = text.split("\ntick ")[1:]
    assert [block.split()[1] for block in blocks] == ["RUNNING"] * 4 + ["SUCCESS"] * 2
    assert "places GreenBox at (0, 0, 0.1) in the frame of YellowBox" in blocks[3]
    assert "✓ ├── move(YellowBox" in blocks[3]
    assert "… └── move(GreenBox" in blocks[3]
    assert "  └── move(GreenBox" in blocks[0]
    assert "ending     SUCCESS at tick 6" in text
    assert "solved     yes" in text


def test_shows_what_changes_from_tick_to_tick(stack):
    *ticks, last = shown(source=stack).split("\ntick ")[1:]
    drawn = [block.splitlines()[1:] for block in (*ticks, last.split("\nending")[0].rstrip())]
    assert [len(lines) for lines in drawn] == [3, 0, 2, 0, 2, 0]
    assert drawn[2] == [
        "✓ ├── move(YellowBox, (0, 0, 0.055), KittingBox)",
        "… └── move(GreenBox, (0, 0, 0.1), YellowBox)",
    ]


def test_drives_and_their_metres_are_told(tmp_path):
    path = tmp_path / "mobile.txt"
    path.write_text(STACK.replace("move", "carry"))
    text = shown(source=path, task="mobile_stack")
    assert "drives towards YellowBox\n" in text
    assert "drives towards (0, 0, 0.1) in the frame of YellowBox\n" in text
    assert "solved     yes" in text
    (metres,) = re.findall(r"driven     ([\d.]+) m\n", text)
    assert 3 < float(metres) < 40
    path.write_text(STACK)
    text = shown(source=path, task="mobile_stack")
    assert "solved     no, YellowBox is out of reach: nothing approaches it" in text


def test_a_failure_is_told(tmp_path):
    path = tmp_path / "half.txt"
    path.write_text(HALF)
    text = shown(source=path)
    assert "ending     TIMEOUT at tick 15" in text
    assert "✗ YellowBox" in text
    assert "solved     no" in text


def test_expand_shows_the_inside_and_changes_nothing_else(stack):
    folded, written = shown(source=stack), shown(source=stack, expand=True)
    assert "open_gripper" not in folded
    assert "open_gripper" in written
    assert folded[folded.index("ending") :] == written[written.index("ending") :]


def test_terminal_gets_colours(stack):
    text = shown(source=stack, terminal=True, delay=0.0)
    assert "\x1b[32m✓" in text
    assert "tick  6" in text


def test_many_layouts(stack, tmp_path):
    assert "success    30 of 30 layouts (100 %)" in shown(source=stack, layouts=30)
    half = tmp_path / "half.txt"
    half.write_text(HALF)
    text = shown(source=half, layouts=22, seed=3)
    assert "success    0 of 22 layouts" in text
    assert text.count("✗ seed") == 20
    assert "and the seeds 23, 24" in text
    single = shown(source=half, seed=4).split("fitness    ")[1].split()[0]
    pair = [float(shown(source=half, layouts=2, seed=seed).split("fitness    ")[1].split()[0]) for seed in (3, 4)]
    singles = [float(shown(source=half, seed=seed).split("fitness    ")[1].split()[0]) for seed in (3, 4, 5)]
    assert float(single) == singles[1]
    assert pair == pytest.approx([sum(singles[:2]) / 2, sum(singles[1:]) / 2], abs=0.11)


def test_a_run_folder_brings_its_task(tmp_path):
    task = load_task("restack")
    folder = RunFolder.create(tmp_path / "run", RunConfig(task, GPConfig(), Settings(level="kinematic")))
    with pytest.raises(UserError, match="holds no tree"):
        shown(source=folder.path, level=None)
    folder.save_tree(parse_tree("Sequence(reached(unstacked), pick(YellowBox))"), title="")
    text = shown(source=folder.path, level=None)
    assert text.startswith("restack")
    assert "kinematic" in text
    with pytest.raises(UserError, match="no such subgoal"):
        shown(source=folder.path, task="stack")


def test_a_layout_of_the_runs_test_is_played_again(stack, tmp_path):
    task = load_task("stack")
    settings = Settings(level="kinematic", test_layouts=5)
    gp, tree = GPConfig(seed=7), parse_tree("move(YellowBox, (0, 0.12, 0), GreenBox)")
    folder = RunFolder.create(tmp_path / "run", RunConfig(task, gp, settings))
    folder.save_tree(tree, title="beside")
    tested = Training(task, gp, settings).test(tree).fitness
    assert len(set(tested)) > 1
    for number, fitness in enumerate(tested, start=1):
        assert f"fitness    {fitness:.1f}\n" in shown(source=folder.path, layout=number)
    with pytest.raises(UserError, match="choose 1 to 5"):
        shown(source=folder.path, layout=6)
    with pytest.raises(UserError, match="name a run folder"):
        shown(source=stack, layout=1)
    with pytest.raises(UserError, match="leave out --layouts and --seed"):
        shown(source=folder.path, layout=1, layouts=2)


def test_an_episode_in_which_things_go_wrong_is_repeated_by_its_numbers(stack, tmp_path):
    task = with_faults(load_task("stack"), load_faults("harsh"))
    settings = Settings(level="kinematic", test_layouts=2, draws=3)
    gp, tree = GPConfig(seed=7), parse_tree(STACK)
    folder = RunFolder.create(tmp_path / "run", RunConfig(task, gp, settings))
    folder.save_tree(tree, title="stack")
    test = Training(task, gp, settings).test(tree)
    for k in range(0, 6, 2):
        layout, draw = divmod(k, 3)
        text = shown(source=folder.path, layout=layout + 1, draw=draw + 1)
        assert f"fitness    {test.fitness[k]:.1f}\n" in text
        assert "mm off" in text
    told = shown(source=folder.path, test=True)
    assert f"success      {test.solved.sum()} of 6 episodes in unseen layouts (95 %: " in told
    assert "misplaced: " in told
    assert "faults" not in shown(source=stack, layouts=2)
    with pytest.raises(UserError, match="nothing does in this task; add --faults"):
        shown(source=stack, draw=2)
    with pytest.raises(UserError, match="leave out the options that choose some"):
        shown(source=folder.path, test=True, draw=2)
    assert "solved" in shown(source=stack, faults="mild", draw=2)


def test_simplify_says_what_it_writes_and_writes_nothing_that_is_the_same(tmp_path):
    folder = RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(), Settings(level="kinematic")))
    folder.save_tree(parse_tree(STACK), title="")
    assert "written" not in shown(source=folder.path, simplify=True)
    assert not list(folder.path.glob("simplified_tree.*"))
    folder.save_tree(parse_tree(f"{STACK}  open_gripper\n"), title="")
    text = shown(source=folder.path, simplify=True)
    written = text.split("written    ")[1].splitlines()[0].split(", ")
    assert written == [str(folder.path / f"simplified_tree.{suffix}") for suffix in ("txt", "xml", "svg")]
    assert read_tree(folder.path / "simplified_tree.txt") == parse_tree(STACK)


def test_a_folder_of_learn_brings_its_task(tmp_path):
    task = dataclasses.replace(load_task("stack"), name="mine")
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(task.to_dict()))
    (tmp_path / "learnt_tree.txt").write_text(STACK)
    assert shown(source=tmp_path).startswith("mine")
    assert load_program(tmp_path).task == task
    assert load_program(tmp_path, "stack3").task == load_task("stack3")
    (tmp_path / "task.yaml").unlink()
    with pytest.raises(UserError, match="name the task with --task"):
        load_program(tmp_path)
    assert load_program(tmp_path, "stack").task == load_task("stack")
    (tmp_path / "alone.txt").write_text("pick(YellowBox)")
    assert load_program(tmp_path / "alone.txt", otherwise="yumi_stack").task == load_task("yumi_stack")
    (tmp_path / "task.yaml").write_text("boxes: [")
    with pytest.raises(UserError, match=r"task\.yaml.* is not valid YAML"):
        shown(source=tmp_path)
    assert shown(source=tmp_path, task="stack").startswith("stack")


def test_the_robot_gets_what_was_given_and_its_exit_code_is_returned(monkeypatch, capsys):
    got = []
    monkeypatch.setattr(
        "bt_jax.deploy.commands.twin.twin_command", lambda arguments, console: got.append(arguments) or 4
    )
    words = [
        "runs/mine",
        "--level",
        "robot",
        "--task",
        "yumi_stack",
        "--seed",
        "3",
        "--layouts",
        "2",
        "--faults",
        "harsh",
    ]
    monkeypatch.setattr(sys, "argv", ["run", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 4
    assert got == [TwinArguments(Path("runs/mine"), "yumi_stack", faults="harsh", seed=3, layouts=2)]
    monkeypatch.setattr(sys, "argv", ["run", *words, "--expand", "--delay", "0"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "does not take --expand and --delay" in capsys.readouterr().err


def test_reads_and_writes_trees(stack, tmp_path):
    xml = tmp_path / "tree.xml"
    assert shown(source=stack, export=xml) == f"written    {xml}\n"
    assert "2 of 2 layouts" in shown(source=stack, export=xml, layouts=2)
    assert from_xml(xml) == parse_tree(STACK) == read_tree(xml)
    assert to_xml(parse_tree(STACK)) == xml.read_text()
    for name in ("tree.svg", "tree.dot", "tree.txt"):
        shown(source=xml, export=tmp_path / name)
    assert read_tree(tmp_path / "tree.txt") == parse_tree(STACK)
    assert (tmp_path / "tree.svg").read_text().startswith("<svg")


@pytest.mark.skipif(available() is not True, reason="nothing can be drawn here")
def test_renders_stills(stack, tmp_path):
    assert "film" in shown(source=stack, render=tmp_path / "film.png")
    assert (tmp_path / "film.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "nonsense"}, "unknown task"),
        ({"layouts": 0}, "--layouts is 0"),
        ({"faults": "gentle"}, "there are no faults 'gentle'; choose one of mild, harsh"),
        ({"faults": "mild", "draw": 0}, "--draw is 0; choose 1 or more"),
        ({"seed": -1}, "--seed is -1"),
        ({"delay": -1.0}, "--delay is -1"),
        ({"export": "tree.doc"}, "no kind of tree file"),
        ({"render": "film.avi"}, "is not a film"),
        ({"render": "no_such_folder/film.gif"}, "cannot be written"),
        ({"export": "stack.txt/tree.xml"}, "cannot be written"),
        ({"source": "missing.txt"}, "there is no file or folder"),
        ({"source": "."}, "holds no tree"),
        ({"source": "wrong.txt"}, "no object 'OrangeBox'"),
        ({"source": "broken.txt"}, "line 2, column 3: unknown node"),
        ({"source": "binary.txt"}, "binary.txt, line 1: not UTF-16-LE text; save the file as UTF-8"),
    ],
)
def test_bad_input_is_named(stack, tmp_path, arguments, message):
    (tmp_path / "wrong.txt").write_text("Sequence(pick(OrangeBox), open_gripper)")
    (tmp_path / "broken.txt").write_text("Sequence\n  lift(YellowBox)\n")
    (tmp_path / "binary.txt").write_bytes(b"\xff\xfe\x00")
    paths = {key: tmp_path / value for key, value in arguments.items() if key in ("source", "render", "export")}
    with pytest.raises(UserError, match=message):
        shown(**{"source": stack, **arguments, **paths})


def test_the_command_line_exits_with_2(tmp_path):
    command = [sys.executable, "-m", "bt_jax.run", str(tmp_path / "missing.txt")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: there is no file")
    assert done.stderr.count("\n") == 1


def test_trees_of_other_programs(tmp_path):
    """Attempts, memory and a main tree that is not named; many layouts, too."""
    path = tmp_path / "groot.xml"
    path.write_text("""<root BTCPP_format="4">
      <BehaviorTree ID="Put"><Sequence><Pick object="{object}"/>
        <Place object="{object}" position="{where}" frame="KittingBox"/></Sequence></BehaviorTree>
      <BehaviorTree ID="Main"><RetryUntilSuccessful num_attempts="3">
        <SubTree ID="Put" object="YellowBox" where="0;0;0.055"/></RetryUntilSuccessful></BehaviorTree></root>""")
    text = shown(source=path, verbose=True)
    assert "RetryUntilSuccessful 3" in text
    assert "ending     SUCCESS at tick 3" in text
    assert "0 of 2 layouts" in shown(source=path, layouts=2)
    exported = tmp_path / "again.xml"
    shown(source=path, export=exported)
    assert read_tree(exported) == read_tree(path)
    with pytest.raises(UserError, match="cannot be simplified, it has RetryUntilSuccessful 3"):
        shown(source=path, simplify=True)


def test_a_tree_of_300_nodes_runs_in_many_layouts(tmp_path):
    path = tmp_path / "large.txt"
    path.write_text(STACK + "  reachable(YellowBox)\n" * 297)
    assert "2 of 2 layouts" in shown(source=path, layouts=2)
    with pytest.raises(UserError, match="it has 300 nodes; give a tree of Sequence, Fallback, retry and timeout, 250"):
        shown(source=path, simplify=True)
