from bt_jax.deploy.commands.replay import replay
from bt_jax.deploy.execution.action_runner import Skills
from bt_jax.deploy.execution.executor import Executor
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.observer import Observer
from bt_jax.deploy.execution.outcome import RunOutcome, TickReport
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.settings import Exit, GraspSettings, Limits, MotionSettings
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.protocol import ArmState, RobotLink
from bt_jax.deploy.link.safety import Rejected, Rules
from bt_jax.deploy.link.settings import LinkConfig, LinkTiming, link_config
from bt_jax.deploy.link.supervision import Supervisor
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import TwinRun, run_twin

__all__ = [
    "YUMI",
    "ArmState",
    "Executor",
    "Exit",
    "GraspSettings",
    "Irc5Link",
    "Limits",
    "LinkConfig",
    "LinkTiming",
    "Log",
    "MotionSettings",
    "Observation",
    "Observer",
    "Perception",
    "Program",
    "Rejected",
    "RobotLink",
    "RobotModel",
    "RobotSkills",
    "Rules",
    "RunOutcome",
    "Skills",
    "Supervisor",
    "TickReport",
    "TwinRun",
    "cell_rules",
    "link_config",
    "load_program",
    "read_log",
    "replay",
    "run_twin",
]
