from bt_jax import behaviors as behaviors
from bt_jax import deploy as deploy
from bt_jax import encoding as encoding
from bt_jax import gp as gp
from bt_jax import lfd as lfd
from bt_jax import mjx_env as mjx_env
from bt_jax import tasks as tasks
from bt_jax import training as training
from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Control
from bt_jax.behaviors.symbols import Behavior
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import format_tree, parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig
from bt_jax.lfd.demonstration_folder import DemonstrationFolder
from bt_jax.lfd.planner import plan_task
from bt_jax.tasks.changes import with_targets
from bt_jax.tasks.files import load_task, task_names
from bt_jax.tasks.task import Target, Task
from bt_jax.training.result import Result
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training, evolve

__version__: str

__all__ = [
    "Behavior",
    "Control",
    "DemonstrationFolder",
    "GPConfig",
    "Result",
    "Settings",
    "Target",
    "Task",
    "Training",
    "UserError",
    "draw_text",
    "evolve",
    "format_tree",
    "from_xml",
    "load_task",
    "parse_tree",
    "plan_task",
    "read_tree",
    "task_names",
    "to_svg",
    "to_xml",
    "with_targets",
]
