"""What demonstrations change in a training, and runs that go on with them."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Control
from bt_jax.commands.arguments import parse_train
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder, Frames, plan_task
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.tasks import load_task
from bt_jax.tasks.changes import not_taken_over
from bt_jax.teaching.script import parse_script, record
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.phases import Changes, resumed, subgoal_name
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training
from tests.helpers.samples import train

STACK, STACK3, RESTACK = (load_task(name) for name in ("stack", "stack3", "restack"))
KINEMATIC = Settings(level="kinematic", test_layouts=10)
CONFIG = RunConfig(STACK, GPConfig(method="population", population=16, generations=5, max_nodes=32), KINEMATIC)
ON_TOP = "pick BlueBox; to (0, 0, 0.105) GreenBox; release"
UNSTACK = """pick GreenBox; to (-1.3, -1.3, 0.75) base_link; release
             pick BlueBox; to (-0.3, -1.3, 0.75) base_link; release"""


def demonstrate(path, task, script, *, count, after=None):
    folder = DemonstrationFolder(path)
    folder.create(Frames.of(task))
    for demonstration in record(task, Kinematic(task), parse_script(script), count=count, after=after):
        folder.append(demonstration)
    return path


@pytest.fixture(scope="module")
def on_top(tmp_path_factory):
    return demonstrate(tmp_path_factory.mktemp("demo") / "on top", STACK3, ON_TOP, count=3, after=plan_task(STACK))


@pytest.fixture(scope="module")
def unstack(tmp_path_factory):
    return demonstrate(tmp_path_factory.mktemp("demo") / "unstack", RESTACK, UNSTACK, count=1)


def test_a_target_brings_its_gene_and_its_tree(on_top):
    config = Changes(target_from=on_top).applied(CONFIG)
    (new,) = set(config.task.targets) - set(STACK.targets)
    assert new.object == "BlueBox"
    assert config.baseline.name == "move"
    assert config.baseline in config.extra_leaves
    assert config.baseline.args == (new.object, new.position, new.frame)
    given = parse_tree("Sequence(open_gripper, close_gripper)")
    assert Changes(baseline=given, target_from=on_top).applied(CONFIG).baseline == given


def test_another_task_brings_its_targets_and_starts_and_nothing_else(on_top):
    task = dataclasses.replace(load_task("pyramid"), name="mine", subgoals=())
    config = dataclasses.replace(CONFIG, task=RESTACK)
    changed = Changes(task=task).applied(config).task
    assert (changed.targets, changed.layout) == (task.targets, task.layout)
    assert (changed.name, changed.subgoals, changed.weights) == (RESTACK.name, RESTACK.subgoals, RESTACK.weights)
    both = Changes(task=STACK, target_from=on_top).applied(config).task
    assert {target.object for target in both.targets} == set(STACK.object_names)
    with pytest.raises(UserError, match=r"other values for objects, tables, kits, .+ than restack; evolve a new tree"):
        Changes(task=load_task("yumi_stack")).applied(config)


def test_a_task_with_another_scene_or_an_impossible_goal_is_refused():
    tables = tuple(dataclasses.replace(table, name=f"Other{table.name}") for table in STACK.tables)
    layout = dataclasses.replace(STACK.layout, kit=tables[0].name)
    for changes, message in (
        (
            {"tables": tables, "layout": layout},
            "stack has other values for tables than stack; evolve a new tree for it",
        ),
        ({"kits": (dataclasses.replace(STACK.kits[0], size=(0.3, 0.3)),)}, "other values for kits than"),
        ({"robot_position": (0.0, 1.1, 0.05)}, "other values for robot_position than"),
        ({"layout": layout}, "stack, key layout.kit: there is no table"),
    ):
        with pytest.raises(UserError, match=message):
            Changes(task=dataclasses.replace(STACK, **changes)).applied(CONFIG)


def test_what_of_another_task_is_not_taken_over_is_named():
    worth = dataclasses.replace(STACK.weights, node=1.0)
    other = dataclasses.replace(STACK, weights=worth, subgoals=RESTACK.subgoals, targets=RESTACK.targets)
    assert not_taken_over(STACK, other) == ["weights", "subgoals"]
    assert not_taken_over(STACK, STACK) == []


def test_a_subgoal_brings_a_guarded_gene_and_a_reward(unstack):
    config = dataclasses.replace(CONFIG, task=dataclasses.replace(RESTACK, subgoals=()))
    config = Changes(subgoal_from=unstack, baseline_index=0).applied(config)
    assert [subgoal.name for subgoal in config.task.subgoals] == ["unstack"]
    assert set(config.task.subgoals[0].conditions) == {"clear(YellowBox)", "clear(BlueBox)", "holding(nothing)"}
    gene = config.baseline
    assert gene.name == "subtask"
    assert str(gene.subtree.children[0]) == "reached(unstack)"
    assert config.gp.baseline_index == 0
    moves = leaves(plan_task(STACK3))
    training = Training(config.task, config.gp, KINEMATIC, baseline=gene, extra_leaves=tuple(moves))
    assert training.test(Control.sequence(gene, *moves)).success_rate == 1
    assert training.test(Control.sequence(*moves)).success_rate == 0


def test_a_subgoal_that_the_task_has_is_not_added_again(unstack):
    config = Changes(subgoal_from=unstack).applied(dataclasses.replace(CONFIG, task=RESTACK))
    assert config.task == RESTACK
    assert config.baseline.args[0] == "unstack"
    assert str(config.baseline.subtree.children[0]) == "reached(unstacked)"


def test_what_does_not_go_together():
    with pytest.raises(UserError, match="two baselines"):
        Changes(baseline=plan_task(STACK), plan=True).applied(CONFIG)
    with pytest.raises(UserError, match="leave out --baseline-index, or give --baseline"):
        Changes(baseline_index=1).applied(CONFIG)
    tree = parse_tree("Fallback(open_gripper, move(BlueBox, (0, 0, 0.1), GreenBox))")
    with pytest.raises(UserError, match="--gene-under-fallback"):
        Training(STACK, CONFIG.gp, KINEMATIC, baseline=tree)


def test_an_index_belongs_to_the_baseline_that_it_was_given_with(tmp_path):
    """A run whose baseline entered as child 1 goes on: only another baseline may have another index, or none."""
    config = dataclasses.replace(CONFIG, baseline=plan_task(STACK))
    folder = RunFolder.create(
        tmp_path / "run", dataclasses.replace(config, gp=dataclasses.replace(config.gp, baseline_index=1))
    )
    training = Training(STACK, CONFIG.gp, KINEMATIC)
    state = training.evolution.step(None)
    folder.save_checkpoint(Checkpoint(state, training.vocabulary.leaves, 0, training.evolution.describe(state)))

    def index(*options, **changes):
        given = parse_train(["--resume", str(folder.path), *options])
        new = Changes(**changes, baseline_index=given.gp.baseline_index)
        return resumed(folder, given.gp, given.settings, new).gp.baseline_index

    assert index() == 1
    assert index(task=load_task("pyramid")) is None
    assert index(baseline=plan_task(STACK)) is None
    assert index("--baseline-index", "2", baseline=plan_task(STACK)) == 2
    for changes in ({}, {"task": load_task("pyramid")}):
        with pytest.raises(UserError, match="leave out --baseline-index, or give --baseline"):
            index("--baseline-index", "3", **changes)


@pytest.mark.parametrize(("name", "wanted"), [("un stack", "un_stack"), ("1", "subgoal_1"), ("aside", "aside")])
def test_subgoals_are_called_as_their_folder(tmp_path, name, wanted):
    assert subgoal_name(tmp_path / name) == wanted


def test_a_population_is_carried_into_another_task(on_top):
    before = Training(STACK, CONFIG.gp, KINEMATIC)
    *_, state = before.evolution.run()
    config = Changes(target_from=on_top).applied(CONFIG)
    after = Training(config.task, config.gp, KINEMATIC, baseline=config.baseline, extra_leaves=config.extra_leaves)
    carried = after.carried(state, before.vocabulary.leaves)
    assert carried.generation == state.generation
    assert carried.earlier == tuple(state.trees_measured)
    assert carried.trees_measured[0] > state.trees_measured[0]
    new = after.best_tree(carried)
    missing = np.asarray(carried.population.fitness)[0] - np.asarray(state.population.fitness)[0]
    assert (missing < 0).sum() >= len(missing) - 1  # BlueBox is not where it should be; one is the baseline now
    row = after.evolution.describe(carried)[0]
    assert (row.baseline_leaves > 0) == (config.baseline in leaves(new))


def test_the_known_solution_is_bred_from_the_lesson(on_top):
    config = Changes(target_from=on_top).applied(CONFIG)
    gp = dataclasses.replace(config.gp, generations=60, population=64, seed=1)
    training = Training(config.task, gp, KINEMATIC, baseline=config.baseline, extra_leaves=config.extra_leaves)
    *_, state = training.evolution.run(target=-60.0)
    assert training.test(training.best_tree(state)).success_rate == 1
    row = training.evolution.describe(state)[0]
    assert row.best >= -60
    found = [node for node in leaves(training.best_tree(state)) if node == config.baseline]
    assert row.baseline_leaves == len(found)
    assert (row.baseline_child >= 0) == bool(found)


QUICK = (
    "--method",
    "population",
    "--level",
    "kinematic",
    "--population",
    8,
    "--max-nodes",
    32,
    "--test-layouts",
    5,
    "--device",
    "cpu",
)


@pytest.fixture(scope="module")
def two_phases(tmp_path_factory, on_top):
    """A run of 4 generations that goes on with a lesson to generation 8, and what its folder was in between."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    done = train("stack", *QUICK, "--generations", 4, "--out", folder)
    assert done.returncode == 0, done.stderr
    shutil.copytree(folder, folder.with_name("between"))
    done = train("--resume", folder, "--add-target-from", on_top, "--baseline-index", 1, "--device", "cpu")
    assert done.returncode == 0, done.stderr
    return folder


def test_a_run_goes_on_with_a_lesson(two_phases):
    folder = RunFolder(two_phases)
    config = folder.config()
    assert (config.phase, config.since, config.gp.generations, config.gp.baseline_index) == (1, 4, 8, 1)
    assert len(config.task.targets) == 3
    assert folder.phases() == [4]
    checkpoint = folder.load_checkpoint()
    assert checkpoint.phase == 1
    assert [row.generation for row in checkpoint.history] == list(range(9))
    assert json.loads((two_phases / "config-0.json").read_text())["phase"] == 0


def test_a_phase_that_was_killed_at_its_beginning_goes_on(two_phases, on_top, tmp_path):
    """The configuration is written first: whatever of the phase was lost follows from it and the old checkpoint."""
    folder = tmp_path / "killed"
    shutil.copytree(two_phases.with_name("between"), folder)
    shutil.copy(two_phases / "config.json", folder)
    done = train("--resume", folder, "--device", "cpu")
    assert done.returncode == 0, done.stderr
    for name in ("history.csv", "best_tree.txt"):
        assert (folder / name).read_bytes() == (two_phases / name).read_bytes()
    ours, theirs = (np.load(path / "checkpoint.npz") for path in (folder, two_phases))
    for name in ours.files:
        np.testing.assert_array_equal(ours[name], theirs[name])


def test_a_run_from_before_there_was_a_rule_for_subgoals_goes_on_with_its_own():
    older = dataclasses.replace(CONFIG, task=dataclasses.replace(RESTACK, subgoal_reward="seen"))
    data = json.loads(older.to_json())
    del data["task"]["subgoal_reward"]
    assert RunConfig.of(data, Path("config.json")) == older
