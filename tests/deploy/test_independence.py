"""What is general of a robot does not know which one it is: YuMi's numbers, its link and the commands do."""

from pathlib import Path

import pytest

from bt_jax import deploy

ROOT = Path(deploy.__file__).parent


@pytest.mark.parametrize("room", ["planning", "execution", "twin", "robot"])
def test_a_general_room_does_not_name_a_robot(room):
    naming = [
        path.name
        for path in sorted((ROOT / room).rglob("*.py"))
        if path != ROOT / "robot" / "yumi.py" and "yumi" in path.read_text(encoding="utf-8").lower()
    ]
    assert not naming
