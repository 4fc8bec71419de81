from bt_jax.app.state.goals import goals, key_of
from bt_jax.app.state.retargeting import untarget
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task
from tests.helpers.trays import TRAYS


def test_a_target_is_found_by_its_key_and_by_its_object():
    start = sample_layouts(TRAYS, 0, 1)
    for key, goal in goals(TRAYS, start).items():
        assert key_of(TRAYS, start, key) == key_of(TRAYS, start, goal.thing) == key


def test_an_object_without_a_target_gets_one_more():
    stack = load_task("stack")
    assert key_of(stack, sample_layouts(stack, 0, 1), "BlueBox") == "BlueBox"
    less = untarget(TRAYS, "Bolt-2")
    start = sample_layouts(less, 0, 1)
    spare = next(
        name for name in less.instances["Bolt"] if name not in {goal.thing for goal in goals(less, start).values()}
    )
    assert key_of(less, start, spare) == "Bolt-2"
