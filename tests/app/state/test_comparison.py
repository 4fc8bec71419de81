"""What differs between runs is named, and nothing else is."""

import dataclasses

from bt_jax.app.state.comparison import differences
from bt_jax.app.state.run_record import RunRecord
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_faults, load_task, with_faults
from bt_jax.training.run_config import RunConfig
from bt_jax.training.settings import Settings

STACK = load_task("stack")
CONFIG = RunConfig(STACK, GPConfig(), Settings())


def compared(*configs):
    records = [RunRecord(str(i), config, None, None, None, ()) for i, config in enumerate(configs)]
    return {row.name: row.values for row in differences(records)}


def test_equal_runs_do_not_differ():
    assert compared() == compared(CONFIG) == compared(CONFIG, CONFIG, dataclasses.replace(CONFIG)) == {}


def test_any_number_of_runs_is_compared_setting_by_setting():
    seed, fewer = GPConfig(seed=3, p_add=0.25), dataclasses.replace(STACK, targets=STACK.targets[:1])
    found = compared(
        CONFIG,
        dataclasses.replace(CONFIG, gp=seed),
        dataclasses.replace(CONFIG, task=fewer, baseline=parse_tree("pick(YellowBox)")),
    )
    assert found == {
        "goal": (
            "YellowBox in the middle of the kit; GreenBox on top of YellowBox",
            "YellowBox in the middle of the kit; GreenBox on top of YellowBox",
            "YellowBox in the middle of the kit",
        ),
        "started from": ("nothing", "nothing", "a tree"),
        "seed": ("0", "3", "0"),
        "p add": ("0.1", "0.25", "0.1"),
    }


def test_what_goes_wrong_is_said_with_its_chances():
    harsh = with_faults(STACK, load_faults("harsh"), source="harsh")
    (clean, faulty) = compared(CONFIG, dataclasses.replace(CONFIG, task=harsh))["what goes wrong"]
    assert clean == "nothing"
    assert "slip 0.15" in faulty
