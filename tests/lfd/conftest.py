"""A folder of demonstrations, for the tests of what it reads and writes."""

import pytest

from bt_jax.lfd import DemonstrationFolder
from tests.helpers.demonstrations import FRAMES, STACK3, STACKING, demonstrations


@pytest.fixture
def folder(tmp_path):
    made = DemonstrationFolder(tmp_path / "stacking")
    made.create(FRAMES)
    for one in demonstrations(STACK3, STACKING):
        made.append(one)
    return made
