import subprocess
import sys

from bt_jax import deploy

NAMES = [
    "YUMI", "ArmState", "Executor", "Exit", "GraspSettings", "Irc5Link", "Limits", "LinkConfig", "LinkTiming", "Log",
    "MotionSettings", "Observation", "Observer", "Perception", "Program", "Rejected", "RobotLink", "RobotModel",
    "RobotSkills", "Rules", "RunOutcome", "Skills", "Supervisor", "TickReport", "TwinRun", "cell_rules", "link_config",
    "load_program", "read_log", "replay", "run_twin",
]  # fmt: skip
EXTRA = ("cv2", "google.protobuf", "httpx", "pinocchio")


def test_the_public_names():
    assert list(deploy.__all__) == NAMES
    for name in NAMES:
        assert getattr(deploy, name) is not None, name


def test_neither_the_package_nor_programs_and_limits_need_the_extra():
    code = (
        f"import sys; from bt_jax.deploy import Limits, load_program; print(*(m for m in {EXTRA} if m in sys.modules))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert loaded == []
