"""Only YuMi's numbers and the commands, which choose the robot, name it."""

from pathlib import Path

import pytest

from bt_jax import deploy

ROOT = Path(deploy.__file__).parent


@pytest.mark.parametrize("room", ["robot", "planning", "link", "execution", "perception", "twin"])
def test_a_general_room_does_not_name_a_robot(room):
    naming = [
        path.name
        for path in sorted((ROOT / room).rglob("*.py"))
        if path != ROOT / "robot" / "yumi.py" and "yumi" in path.read_text(encoding="utf-8").lower()
    ]
    assert not naming
