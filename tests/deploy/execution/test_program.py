"""What a robot cannot execute is refused before it moves."""

import pytest
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import MarkersArguments, RapidArguments, TwinArguments
from bt_jax.deploy.commands.markers import markers_command
from bt_jax.deploy.commands.rapid import rapid_command
from bt_jax.deploy.commands.serve import serve_twin
from bt_jax.deploy.execution.program import load_program


@pytest.mark.parametrize(
    "command",
    [
        lambda tree: load_program(tree, "mobile_stack"),
        lambda tree: markers_command(MarkersArguments(task="mobile_stack")),
        lambda tree: rapid_command(RapidArguments(task="mobile_stack")),
        lambda tree: serve_twin(TwinArguments(source=None, task="mobile_stack", serve=True), Console()),
    ],
    ids=["run", "markers", "rapid", "serve"],
)
def test_a_task_whose_robot_drives_is_refused(command, tmp_path):
    tree = tmp_path / "tree.txt"
    tree.write_text("pick(YellowBox)\n")
    with pytest.raises(UserError) as caught:
        command(tree)
    assert str(caught.value) == (
        "the robot of task mobile_stack drives, and this one does not; use a task without robot.base"
    )
