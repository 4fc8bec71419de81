import importlib
import pkgutil
import subprocess
import sys

import pytest

import bt_jax

FACES = {
    "bt_jax": [
        "Behavior", "Control", "DemonstrationFolder", "GPConfig", "Result", "Settings", "Target", "Task", "Training",
        "UserError", "draw_text", "evolve", "format_tree", "from_xml", "load_task", "parse_tree", "plan_task", "read_tree",
        "task_names", "to_svg", "to_xml", "with_targets",
    ],
    "bt_jax.behaviors": [
        "CLOSED", "CONTROLS", "EXTENDED", "FIRST_LEAF", "NOTHING", "OPEN", "SIGNATURES", "Argument", "Behavior", "Control",
        "Decorator", "ExtendedNode", "Kind", "Leaf", "Node", "Parser", "Symbol", "Token", "Tree", "Vocabulary",
        "check_names", "expand", "gene_pool", "is_spot", "not_memoryless", "not_reactive", "parse_behavior",
        "placing_gene", "subgoal_conditions",
    ],
    "bt_jax.deploy": [
        "YUMI", "ArmState", "Executor", "Exit", "GraspSettings", "Irc5Link", "Limits", "LinkConfig", "LinkTiming",
        "Log", "MotionSettings", "Observation", "Observer", "Perception", "Program", "Rejected", "RobotLink",
        "RobotModel", "RobotSkills", "Rules", "RunOutcome", "Skills", "Supervisor", "TickReport", "TwinRun",
        "cell_rules", "link_config", "load_program", "read_log", "replay", "run_twin",
    ],
    "bt_jax.encoding": [
        "MAX_NODES", "Counters", "JumpTable", "Status", "Ticked", "TreeMemory", "TreeTick", "Trees", "children", "counters",
        "decode", "decorators", "depth",
        "draw_text", "encode", "encode_all", "format_tree", "from_xml", "jump_table", "leaves", "length", "one_line",
        "parse_tree", "prefix", "read_tree", "tick_tree", "tick_trees", "to_dot", "to_py_trees", "to_svg", "to_xml",
        "violations",
    ],
    "bt_jax.gp": [
        "AchievementSearch", "Alphabet", "Evolution", "GPConfig", "Generation", "Goals", "Measured", "Population",
        "Selection", "State", "best_of", "is_valid",
    ],
    "bt_jax.mjx_env": [
        "Ending", "EpisodeState", "Evaluation", "Kinematic", "LeafSemantics", "Physics", "Playback", "Renderer",
        "RolloutEvaluator", "Settled", "Settler", "TableEvaluator", "Tick", "World", "film", "make_physics", "play",
        "sample_layouts",
    ],
    "bt_jax.tasks": [
        "Base", "Episode", "Faults", "GeneSettings", "Kit", "Layout", "Object", "Problem", "Robot", "Slot", "Subgoal",
        "Table", "Target", "Task", "Weights", "load_faults", "load_task", "parse_task", "problems", "task_from_dict",
        "task_names", "task_of_folder", "with_faults", "with_goal_of", "with_subgoal", "with_target", "with_targets",
    ],
    "bt_jax.experiments": [
        "EXPERIMENTS", "Experiment", "PublishedCurve", "VariantResult", "perform", "published_curves",
    ],
    "bt_jax.lfd": [
        "Action", "Answer", "Candidate", "Corrections", "Demonstration", "DemonstrationFolder", "Demonstrations", "Frames",
        "Inference", "Instance", "Lesson", "Pose", "Proposal", "Question", "RecordedTask", "learn", "open_questions", "plan",
        "plan_task", "propose",
    ],
    "bt_jax.teaching": [
        "Input", "Landing", "Teleoperation", "parse_script", "perform", "reached_by", "record",
    ],
    "bt_jax.training": [
        "Changes", "Checkpoint", "Listener", "Progress", "Result", "RunConfig", "RunFolder", "Session",
        "Settings", "Test", "Training", "TrainingRun", "evolve", "is_alive", "make_level", "published_config",
        "read_progress", "resumed",
    ],
}  # fmt: skip
HEAVY = ("jax", "mujoco", "numpy", "scipy", "sklearn", "matplotlib", "rich", "tyro", "yaml")


@pytest.mark.parametrize("package", FACES)
def test_the_public_names(package):
    face = importlib.import_module(package)
    assert list(face.__all__) == FACES[package]
    for name in face.__all__:
        assert getattr(face, name) is not None, name


@pytest.mark.parametrize("package", FACES)
def test_no_public_name_is_hidden_by_a_module(package):
    modules = {module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__)}
    assert not modules & set(FACES[package])


def test_importing_the_package_imports_nothing_heavy():
    code = f"import sys, bt_jax; bt_jax.gp; bt_jax.mjx_env; print(*(m for m in {HEAVY} if m in sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert loaded == []


def test_a_notebook_draws_trees_and_tables_tasks():
    tree = bt_jax.parse_tree("Sequence(pick(YellowBox), place(YellowBox, (0, 0, 0.1), GreenBox))")
    assert repr(tree) == str(tree)
    assert bt_jax.parse_tree(repr(tree)) == tree
    assert tree._repr_svg_() == bt_jax.to_svg(tree)
    task = bt_jax.load_task("stack")
    assert repr(task) == "<Task stack: 3 objects, 2 targets>"
    assert "GreenBox at (0, 0, 0.1) in YellowBox" in str(task)
    assert "<td>GreenBox at (0, 0, 0.1) in YellowBox</td>" in task._repr_html_()
