"""Training by the search for achievements: what it sees of a task, that it solves it, and that a run goes on where it
stopped."""

import dataclasses

import jax
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Control, gene_pool
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import decorators, leaves
from bt_jax.gp.config import GPConfig
from bt_jax.gp.search import AchievementSearch
from bt_jax.lfd import plan_task
from bt_jax.tasks import Faults, Target, load_task, with_faults
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.console import TrainingDisplay
from bt_jax.training.goals import goals_of, measured
from bt_jax.training.run import TrainingRun
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training, evolve
from tests.helpers.samples import assert_same

CONFIG = GPConfig(seed=1)
QUICK = Settings(level="kinematic", test_layouts=20)
STACK3, FIXTURE = load_task("stack3"), load_task("fixture")


def renamed(task, names):
    """The same objects under other names."""
    new = dict(zip(task.object_names, names, strict=True))
    boxes = tuple(dataclasses.replace(box, name=new[box.name]) for box in task.objects)
    targets = tuple(
        dataclasses.replace(target, object=new[target.object], frame=new.get(target.frame, target.frame))
        for target in task.targets
    )
    layout = dataclasses.replace(task.layout, stack=tuple(new[name] for name in task.layout.stack))
    kits = tuple(
        dataclasses.replace(
            kit, slots=tuple(dataclasses.replace(one, takes=new.get(one.takes, "")) for one in kit.slots)
        )
        for kit in task.kits
    )
    return dataclasses.replace(task, objects=boxes, targets=targets, layout=layout, kits=kits)


def test_the_search_is_told_which_box_a_gene_moves_and_which_are_wanted():
    task = load_task("restack")
    vocabulary = gene_pool(task).extended([parse_tree("subtask(all, Sequence(pick(GreenBox), pick(BlueBox)))")])
    vocabulary = vocabulary.extended([parse_tree("subtask(one, place(GreenBox, (0, 0, 0.1), BlueBox))")])
    goals = goals_of(task, vocabulary)
    groups = {str(leaf): goals.group[vocabulary.token(leaf)] for leaf in vocabulary.leaves}
    assert groups["move(GreenBox, (0, 0, 0.1), YellowBox)"] == task.object_names.index("GreenBox")
    assert groups["open_gripper"] == groups["reached(unstacked)"] == -1
    assert groups["subtask(one, place(GreenBox, (0, 0, 0.1), BlueBox))"] == task.object_names.index("GreenBox")
    assert [task.object_names[i] for i in goals.concerns[:-1]] == [target.object for target in task.targets]
    assert goals.concerns[-1] == -1
    assert str(vocabulary.leaf(int(goals.guard[-1]))) == "reached(unstacked)"


@pytest.mark.parametrize(
    ("task", "names"),
    [
        ("stack3", ("BlueBox", "YellowBox", "GreenBox")),
        ("fixture", FIXTURE.object_names[::-1]),
        pytest.param("restack", ("Zebra", "Aardvark", "GreenBox"), marks=pytest.mark.slow),
    ],
)
def test_a_task_with_shuffled_names_is_solved_and_its_run_stops(task, names):
    result = evolve(renamed(load_task(task), names), CONFIG, QUICK)
    assert result.success_rate == 1.0
    assert result.generations < CONFIG.num_generations
    assert (
        result.history[-1].achieved
        == result.history[-1].understood
        == len(load_task(task).targets) + len(load_task(task).subgoals)
    )


def test_where_the_targets_are_is_not_known_to_the_search():
    """Tasks whose targets exchange their places ask for the same, as long as they hear the same of episodes."""
    places = [(-0.133, 0.0, 0.055), (0.0, 0.0, 0.055), (0.133, 0.133, 0.055)]
    one, other = (Training(in_the_kit(order), CONFIG, QUICK) for order in (places, places[::-1]))
    known = [dataclasses.asdict(goals_of(training.task, training.vocabulary)) for training in (one, other)]
    assert_same(*known)
    state = same = None
    for _ in range(6):
        offspring = one.evolution.ask(state)
        assert_same(offspring, other.evolution.ask(same))
        measured = one.evolution.evaluate(offspring)
        state, same = one.evolution.tell(state, offspring, measured), other.evolution.tell(same, offspring, measured)


def in_the_kit(places):
    targets = [Target(name, place, "KittingBox") for name, place in zip(STACK3.object_names, places, strict=True)]
    return dataclasses.replace(STACK3, targets=tuple(targets))


@pytest.mark.parametrize(("runs", "layouts"), [(1, 1), (1, 4), pytest.param(2, 1, marks=pytest.mark.slow)])
def test_a_run_goes_on_from_its_checkpoint_as_if_it_had_never_stopped(tmp_path, runs, layouts):
    config, settings = (
        dataclasses.replace(CONFIG, runs=runs, generations=8),
        dataclasses.replace(QUICK, layouts=layouts),
    )
    training = Training(STACK3, config, settings)
    states = list(training.evolution.run())
    history = training.evolution.describe(states[3])
    Checkpoint(states[3], training.vocabulary.leaves, 0, history, training.run_config).save(tmp_path / "state.npz")
    saved = Checkpoint.load(tmp_path / "state.npz")
    assert saved.history == [dataclasses.replace(row, **rounded(row)) for row in history]
    assert_same(saved.state.knowledge, states[3].knowledge)
    assert history[-1].episodes == layouts * states[3].trees_measured[-1]
    again = list(Training(STACK3, config, settings).evolution.run(saved.state))
    assert_same([state.knowledge for state in again], [state.knowledge for state in states[3:]])
    assert_same([state.population for state in again], [state.population for state in states[3:]])
    for one, other in zip(again, states[3:], strict=True):
        assert_same(one.seen, other.seen)


@pytest.mark.slow
def test_a_run_under_faults_learns_to_wait_and_goes_on_where_it_stopped(tmp_path):
    """Only what is out of sight makes a tree of genes fail; a retry gets over that, or a look before the gene."""
    task = with_faults(load_task("stack"), Faults(hide=0.15))
    config, settings = GPConfig(seed=1, generations=14), Settings(level="kinematic", layouts=2, draws=8)
    training = Training(task, config, settings)
    states = list(training.evolution.run())
    tree = training.best_tree(states[-1])
    assert decorators(tree) or any(leaf.name == "look" for leaf in leaves(tree))
    plain = Control.sequence(*(leaf for leaf in leaves(tree) if leaf.name == "move"))
    plain, found = (training.test(one, count=20).success_rate for one in (plain, tree))
    assert found > plain + 0.2
    row = training.evolution.describe(states[-1])[0]
    assert 0.5 < row.success <= 1
    Checkpoint(states[9], training.vocabulary.symbols, 0, [], training.run_config).save(tmp_path / "state.npz")
    saved = Checkpoint.load(tmp_path / "state.npz")
    assert saved.symbols == training.vocabulary.symbols
    again = list(Training(task, config, settings).evolution.run(saved.state))
    assert_same([state.knowledge for state in again], [state.knowledge for state in states[9:]])


def test_a_checkpoint_of_before_misses_were_kept_goes_on(tmp_path):
    training = Training(STACK3, dataclasses.replace(CONFIG, generations=4), QUICK)
    state = training.evolution.step(None)
    Checkpoint(state, training.vocabulary.leaves, 0, [], training.run_config).save(tmp_path / "state.npz")
    with np.load(tmp_path / "state.npz") as arrays:
        older = {name: arrays[name] for name in arrays if name != "kept_missed"}
    np.savez(tmp_path / "older.npz", **older)
    saved = Checkpoint.load(tmp_path / "older.npz")
    archive, kept = state.knowledge[0].archive, saved.state.knowledge[0].archive
    assert_same(kept, dataclasses.replace(archive, missed=np.zeros_like(archive.missed)))
    assert training.evolution.step(saved.state).generation == 1


def test_a_checkpoint_of_before_only_pairs_that_were_met_were_kept_goes_on(tmp_path):
    training = Training(STACK3, dataclasses.replace(CONFIG, runs=2, generations=4), QUICK)
    state = training.evolution.step(training.evolution.step(None))
    Checkpoint(state, training.vocabulary.leaves, 0, [], training.run_config).save(tmp_path / "state.npz")
    with np.load(tmp_path / "state.npz") as arrays:
        older = {name: arrays[name] for name in arrays if not name.startswith("pair_")}
    tokens = np.arange(older["tested"].shape[1])
    counts = [known.linkage.pairs.counts(tokens[:, None], tokens) for known in state.knowledge]
    older["pairs"], older["order"] = (np.stack(count) for count in zip(*counts, strict=True))
    assert older["pairs"].any()
    np.savez(tmp_path / "older.npz", **older)
    saved = Checkpoint.load(tmp_path / "older.npz")
    assert_same(saved.state.knowledge, state.knowledge)


def test_several_layouts_tell_rates_and_any_fitness_of_them_will_do():
    """The mean of the worst quarter here, which is the conditional value at risk."""
    training = Training(STACK3, CONFIG, dataclasses.replace(QUICK, layouts=4))
    rates = set()

    def measure(trees):
        runs, count, _ = trees.tokens.shape
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1, leaf.shape[-1]), jax.device_get(trees))
        episodes = training.evaluator(flat, training.layouts)
        found = measured(episodes, STACK3, (runs, count))
        rates.update(np.unique(found.achieved).tolist())
        np.testing.assert_array_equal(found.achieved[0], episodes.misses.met.mean(axis=1))
        worst = episodes.values.min(axis=1)
        return dataclasses.replace(found, fitness=worst.reshape(runs, count))

    goals = goals_of(STACK3, training.vocabulary)
    search = AchievementSearch(CONFIG, training.vocabulary.kinds, goals, measure, episodes_per_tree=4)
    *_, state = search.run()
    assert training.test(training.best_tree(state)).solved.all()
    assert {0.0, 1.0} < rates <= {0.0, 0.25, 0.5, 0.75, 1.0}


def rounded(row):
    return {name: float(f"{value:.4f}") for name, value in dataclasses.asdict(row).items() if isinstance(value, float)}


@pytest.mark.slow
def test_another_phase_begins_with_what_achieved_the_most():
    training = Training(STACK3, CONFIG, QUICK)
    *_, state = training.evolution.run()
    more = Training(STACK3, CONFIG, QUICK, extra_leaves=(parse_tree("move(BlueBox, (0.2, 0, 0), YellowBox)"),))
    carried = more.carried(state, training.vocabulary.leaves)
    assert carried.knowledge[0].solved
    assert carried.generation == state.generation
    np.testing.assert_allclose(carried.population.fitness.max(), state.population.fitness.max(), atol=0.01)


def test_a_place_that_is_not_in_the_gene_pool_is_named(tmp_path, capsys):
    config = RunConfig(load_task("pyramid"), dataclasses.replace(CONFIG, generations=25), QUICK)
    ran(tmp_path / "run", config)
    out = capsys.readouterr().out
    assert "limit        no gene meets the target of GreenBox, and all were tried; go on with --resume" in out
    assert "advice" not in out


@pytest.mark.parametrize("wrong", [{"niches": True}, {"baseline_index": 0}, {"elites": 3}, {"patience": 0}])
def test_what_the_method_does_not_take_is_refused(wrong):
    with pytest.raises(UserError, match=next(iter(wrong))):
        dataclasses.replace(CONFIG, **wrong).check()


def test_patience_is_for_this_method():
    with pytest.raises(UserError, match=r"patience is a setting of the method achievements.*; choose --method ach"):
        GPConfig(method="population", patience=20).check()


def test_a_run_that_has_ended_says_so_and_goes_on_for_as_many_generations_as_it_is_told(tmp_path, capsys):
    config = RunConfig(load_task("stack"), CONFIG, QUICK)
    ended = ran(tmp_path / "run", config)
    out = capsys.readouterr().out
    assert "the run had ended" not in out
    assert "limit  " not in out
    assert ran(tmp_path / "run", config, resumed=True).generations == ended.generations
    assert "the run had ended; go on with --resume" in capsys.readouterr().out
    longer = dataclasses.replace(config, gp=dataclasses.replace(CONFIG, generations=ended.generations + 5))
    ran(tmp_path / "run", longer, resumed=True)
    ran(tmp_path / "whole", longer)
    assert (tmp_path / "run" / "history.csv").read_bytes() == (tmp_path / "whole" / "history.csv").read_bytes()


def ran(path, config, *, resumed=False):
    """The result of a run in its folder, which the console shows."""
    run = TrainingRun(RunFolder(path), config, resumed=resumed)
    display = TrainingDisplay(run.training, path)
    with run.opened(display):
        result, session = run.evolve()
        display.finish(result, session)
    return result


def test_a_number_of_generations_that_is_given_is_kept():
    result = evolve(load_task("stack"), dataclasses.replace(CONFIG, generations=30), QUICK)
    assert result.generations == 30
    assert evolve(load_task("stack"), CONFIG, QUICK).generations < 30
    both = dataclasses.replace(CONFIG, generations=30, patience=3)
    assert evolve(load_task("stack"), both, QUICK).generations < 30


@pytest.mark.slow
def test_what_was_demonstrated_is_used_at_once():
    """A place that is not in the gene pool, and a step on the way that is one gene."""
    pyramid, restack = load_task("pyramid"), load_task("restack")
    top = next(leaf for leaf in leaves(plan_task(pyramid)) if leaf.args[0] == "GreenBox")
    result = evolve(pyramid, CONFIG, QUICK, baseline=top)
    assert result.success_rate == 1.0
    assert result.trees_measured[0] < 500
    away = "Sequence(move(GreenBox, (-1.3, -1.3, 0.75), base_link), move(BlueBox, (-0.3, -1.3, 0.75), base_link))"
    gene = parse_tree(f"subtask(aside, Fallback(reached(unstacked), {away}))")
    result = evolve(restack, CONFIG, QUICK, baseline=gene)
    assert result.success_rate == 1.0
    assert result.tree.children[0] == gene
    assert len(result.tree.children) == 4
    assert result.trees_measured[0] < 1000
