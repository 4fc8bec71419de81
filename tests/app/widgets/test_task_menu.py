from bt_jax.app.widgets.task_menu import listed_tasks
from bt_jax.tasks import task_names


def test_own_tasks_come_first_and_numbers_count_as_numbers():
    names = listed_tasks([*task_names(), "mine", "a_kit"])
    assert names[:2] == ["a_kit", "mine"]
    kits = [name for name in names if name.startswith("kit")]
    assert kits == ["kit4", "kit6", "kit9", "kit12"]
    assert names.index("towers") < names.index("yumi_bolts")
    assert sorted(names) == sorted([*task_names(), "mine", "a_kit"])
