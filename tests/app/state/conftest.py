"""The state of the page without a browser, in a scene without dynamics."""

import pytest

from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.tasks import load_task


@pytest.fixture
def studio(tmp_path, monkeypatch):
    monkeypatch.setattr("bt_jax.app.state.worker.MujocoPhysics", lambda task, **_: Kinematic(task))
    return Studio(Workspace(tmp_path), load_task("stack"))
