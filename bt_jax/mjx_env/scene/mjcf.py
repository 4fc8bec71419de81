"""The scene of a task as MJCF: floor, tables, kits and objects, with contacts tuned for stacking.

Each kit is one mocap body, since its place differs from episode to episode; every object has a free joint. World frame: x
along the row of tables, z up, floor at z = 0 or under the lowest table. Quaternions are wxyz.

Objects, kits and tables have their own names; those of all else contain a slash, so that no name of a task is one of them.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.tasks import Base, Kit, Object, Slot, Task
from bt_jax.tasks.support import kit_origin

__all__ = [
    "DRIVEN_BASE",
    "FLOOR",
    "GRIPPER",
    "PAD",
    "PALM",
    "ROCKING_TURN",
    "SceneIds",
    "Timing",
    "build_mjcf",
    "compile_scene",
    "gripper_unit",
    "kit_geoms",
    "resolve_ids",
    "timing",
]

Vec3 = tuple[float, float, float]
Geom = tuple[str, tuple[float | int, ...], tuple[float | int, ...], str]  # type, centre, half sizes, material

GRAVITY = 9.81
STEP = 0.01  # seconds, for boxes of REFERENCE_SIZE
MAX_STEPS = 400  # until what still moves counts as at rest, where all edges are alike
ROLLING = 0.05  # friction of a rolling cylinder, in its radii: without it, it would never come to rest
REFERENCE_SIZE = 0.1
WINDOW = 96  # steps
ROCKING_TURN = 0.02  # of a quaternion's components: 2 degrees
FILLED = 0.97  # how much of the picture's width the tables fill
PALM, PAD = 0.92, 0.3  # height of the palm over the tips, and half that of the pads, in units of the gripper
FLOOR = "scene/floor"
GRIPPER = ("scene/gripper", "scene/finger_right", "scene/finger_left")  # the bodies of palm and fingers
DRIVEN_BASE = "scene/base"  # the body of a base that drives
FIELD_OF_VIEW = 42  # degrees across the picture, whatever its shape


@dataclasses.dataclass(frozen=True)
class Timing:
    """Time, speed and length scales of a task, from the shortest edge of its objects by Froude similarity: a scene half as
    large moves the same way, in less time. `step` is the time step [s]; `speed` [m/s] and `spin` [rad/s] are what still
    counts as rest; `far` [m] is where an object can only be after an explosion. `most_steps` is the most steps until rest:
    they follow from the longest edge, since the larger an object is, the longer it falls. After each `window` steps but the
    first, objects that have only rocked in place, by less than `rocking` [m] and ROCKING_TURN, are at rest, too."""

    size: float
    step: float
    speed: float
    spin: float
    far: float
    most_steps: int
    window: int
    rocking: float


def timing(task: Task) -> Timing:
    """Return the scales of a task."""
    size, longest = min(min(thing.size) for thing in task.objects), max(thing.edge for thing in task.objects)
    ratio = size / REFERENCE_SIZE
    extent = max(max(map(abs, table.position)) + max(table.size) for table in task.tables)
    most_steps = round(MAX_STEPS * math.sqrt(longest / size))
    return Timing(
        size=size,
        step=round(STEP * math.sqrt(ratio), 5),
        speed=0.01 * math.sqrt(ratio),
        spin=0.2 / math.sqrt(ratio),
        far=extent + 50 * longest,
        most_steps=most_steps,
        window=most_steps if task.all_cubes else WINDOW,  # cubes stay as they were published
        rocking=size / 20,
    )


def build_mjcf(task: Task, boxes: Sequence[str] | None = None, *, gripper: bool = False) -> str:
    """Return MJCF of the scene with the objects named, in that order (default: all, in the task's), and for pictures with a
    gripper.

    qpos is the objects' poses one after another (xyz, wxyz) and the first rows of `mocap_pos` are the kits' frames. Lengths
    in metres.
    """
    chosen = task.objects if boxes is None else [task.thing(name) for name in boxes]
    scales = timing(task)
    contents = [
        _floor(task),
        *(_table(table.name, table.position, table.size) for table in task.tables),
        *(_kit(task, kit) for kit in task.kits),
        *(_box(box, i, task) for i, box in enumerate(chosen)),
        *([_gripper(task)] if gripper else []),
        *([_base(task, task.robot.base)] if gripper and task.robot.base is not None else []),
        _cameras_and_lights(task),
    ]
    return f"""<mujoco model="{task.name}">
  <compiler autolimits="true"/>
  <option timestep="{scales.step:g}" gravity="0 0 -{GRAVITY}" cone="pyramidal" solver="Newton" iterations="20"
          ls_iterations="20" tolerance="1e-8">
    <flag autoreset="disable"/>
  </option>
  <size memory="4M"/>
  <visual>
    <global offwidth="1920" offheight="1080"/>
    <quality offsamples="4" shadowsize="2048"/>
    <headlight ambient=".36 .37 .39" diffuse=".12 .12 .12" specular="0 0 0"/>
    <map znear=".01" zfar="60"/>
  </visual>
  <default>
    <geom friction="1 .005 .0001" condim="3" solref="{2 * scales.step:g} 1" solimp=".95 .99 {scales.size / 100:g}"/>
    <default class="fixed">
      <geom type="box" contype="0" conaffinity="1"/>
    </default>
    <default class="box">
      <geom type="box" contype="1" conaffinity="1"/>
    </default>
    <default class="visual">
      <geom type="box" contype="0" conaffinity="0" group="2" mass="0"/>
    </default>
  </default>
  <asset>
    <texture name="scene/sky" type="skybox" builtin="gradient" rgb1=".62 .67 .73" rgb2=".45 .50 .57" width="64"
             height="384"/>
    <material name="scene/floor" rgba=".50 .54 .59 1" specular="0"/>
    <material name="scene/table" rgba=".80 .77 .72 1" specular=".1" shininess=".3"/>
    <material name="scene/kit" rgba=".27 .31 .37 1" specular=".3" shininess=".4"/>
    <material name="scene/slot" rgba=".45 .50 .58 1" specular="0"/>
    <material name="scene/metal" rgba=".62 .64 .68 1" specular=".8" shininess=".7"/>
    <material name="scene/rubber" rgba=".16 .17 .19 1" specular=".2" shininess=".2"/>
{_lines("    ", (_box_material(box) for box in chosen))}
  </asset>
  <worldbody>
{_lines("    ", contents)}
  </worldbody>
</mujoco>
"""


@dataclasses.dataclass(frozen=True)
class SceneIds:
    """Indices into a compiled scene: bodies, free joints' qpos and dof addresses (per object), and the kits' bodies and
    mocap rows."""

    objects: tuple[int, ...]
    qpos: tuple[int, ...]
    dof: tuple[int, ...]
    kits: tuple[int, ...]
    kit_mocaps: tuple[int, ...]


def resolve_ids(model: mujoco.MjModel, task: Task) -> SceneIds:
    """Return the indices of those boxes of the task that the model has, in the task's order, and of the kits."""
    bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in task.object_names]
    bodies = [body for body in bodies if body >= 0]
    joints = [model.body_jntadr[body] for body in bodies]
    kits = tuple(int(model.body(name).id) for name in task.kit_names)
    return SceneIds(
        objects=tuple(bodies),
        qpos=tuple(int(model.jnt_qposadr[joint]) for joint in joints),
        dof=tuple(int(model.jnt_dofadr[joint]) for joint in joints),
        kits=kits,
        kit_mocaps=tuple(int(model.body_mocapid[kit]) for kit in kits),
    )


@functools.lru_cache(maxsize=128)
def compile_scene(
    task: Task, boxes: tuple[str, ...] | None = None, gripper: bool = False
) -> tuple[mujoco.MjModel, SceneIds]:
    """Return the compiled scene and its indices; kept per task and set of boxes, so do not change the model. Raise UserError
    if MuJoCo refuses it."""
    try:
        model = mujoco.MjModel.from_xml_string(build_mjcf(task, boxes, gripper=gripper))
    except ValueError as error:
        problem = "; ".join(str(error).removeprefix("Error: ").splitlines())
        raise UserError(
            f"MuJoCo cannot simulate the task {task.name} ({problem}); change the sizes or densities"
        ) from error
    return model, resolve_ids(model, task)


def _lines(indent: str, parts: Iterable[str]) -> str:
    return "\n".join(indent + line for part in parts for line in part.splitlines())


def _numbers(*values: float | int | np.floating) -> str:
    return " ".join(f"{value:.7g}" for value in values)


def _floor(task: Task) -> str:
    position = f"0 0 {task.floor:g}"
    return f'<geom name="{FLOOR}" class="fixed" type="plane" size="0 0 .05" pos="{position}" material="scene/floor"/>'


def _table(name: str, position: Vec3, size: Vec3) -> str:
    half = _numbers(*(edge / 2 for edge in size))
    return f'<geom name="{name}" class="fixed" pos="{_numbers(*position)}" size="{half}" material="scene/table"/>'


def _kit(task: Task, kit: Kit) -> str:
    position = kit_origin(task, task.tables[len(task.tables) // 2], kit.name)
    middle, high = kit.plate + kit.wall_height / 2, kit.wall_height / 2
    walls = [((*xy, middle), (*half, high)) for xy, half in kit.walls()]
    parts = zip(kit_geoms(kit), [((0, 0, 0), (*kit.half, kit.plate)), *walls], strict=True)
    geoms = [
        f'<geom name="{name}" class="fixed" pos="{_numbers(*pos)}" size="{_numbers(*size)}" material="scene/kit"/>'
        for name, (pos, size) in parts
    ]
    marks = [_slot_mark(kit, slot) for slot in (kit.slots if kit.dividers else kit.places)]
    return (
        f'<body name="{kit.name}" mocap="true" pos="{_numbers(*position)}">\n{_lines("  ", [*geoms, *marks])}\n</body>'
    )


def kit_geoms(kit: Kit) -> list[str]:
    """Return the names of a kit's geoms: its plate, then its walls in the order of `Kit.walls`."""
    outer = ["wall_left", "wall_right", "wall_front", "wall_back"]
    names = [*outer, *(f"divider_{number}" for number in range(len(list(kit.walls())) - len(outer)))]
    return [f"{kit.name}/{name}" for name in ("plate", *names)]


def _slot_mark(kit: Kit, slot: Slot) -> str:
    """Return a thin bright patch on the plate, with no contacts, so that pictures show where the slot is."""
    edge = 0.08 * min(kit.size)
    position = _numbers(*slot.position, kit.plate)
    yaw, size = f"0 0 {slot.turn:g}", _numbers(edge, edge / 4, 0.001)
    return f'<geom class="visual" pos="{position}" euler="{yaw}" size="{size}" material="scene/slot"/>'


def _box_material(box: Object) -> str:
    return f'<material name="{box.name}" rgba="{_numbers(*box.color, 1)}" specular=".25" shininess=".3"/>'


def _box(box: Object, index: int, task: Task) -> str:
    table = task.tables[index % len(task.tables)]
    position = _numbers(table.position[0], table.position[1], table.top + box.height / 2)
    half = [edge / 2 for edge in box.size]
    size = f'size="{_numbers(*half)}"'
    if box.shape == "cylinder":
        friction = f'friction="1 .005 {_numbers(ROLLING * half[0])}" condim="6"'
        size = f'type="cylinder" size="{_numbers(half[0], half[2])}" {friction}'
    return f"""<body name="{box.name}" pos="{position}">
  <freejoint/>
  <geom name="{box.name}" class="box" {size} density="{box.density:g}" material="{box.name}"/>
</body>"""


def gripper_unit(task: Task) -> float:
    """Return the length, metres, that the drawn gripper is made to: of the widest object, seen along its narrow side."""
    return max(min(thing.size[:2]) for thing in task.objects)


def _gripper(task: Task) -> str:
    """Return three mocap bodies without contacts: palm and two fingers; `render` places them."""
    unit = gripper_unit(task)
    thick, wide, long = 0.07 * unit, 0.22 * unit, 0.55 * unit
    palm: list[Geom] = [
        ("box", (0, 0, (PALM + 0.1) * unit), (0.62 * unit, 0.26 * unit, 0.1 * unit), "metal"),
        ("cylinder", (0, 0, 1.3 * unit), (0.2 * unit, 0.2 * unit), "metal"),
        ("cylinder", (0, 0, 1.52 * unit), (0.28 * unit, 0.06 * unit), "rubber"),
    ]
    finger: list[Geom] = [
        ("box", (thick, 0, long - 0.15 * unit), (thick, wide, long), "metal"),
        ("box", (0.12 * thick, 0, 0), (0.2 * thick, 0.9 * wide, PAD * unit), "rubber"),
    ]
    mirrored: list[Geom] = [(kind, (-pos[0], *pos[1:]), size, material) for kind, pos, size, material in finger]
    return "\n".join(map(_visual_body, GRIPPER, (palm, finger, mirrored)))


def _base(task: Task, base: Base) -> str:
    """Return a mocap body without contacts: a disc on the floor, and a column on it that carries the arm; `render` places
    it."""
    top, foot = task.robot_position[2] - task.floor, min(0.3, task.robot_position[2] - task.floor)
    parts: list[Geom] = [
        ("cylinder", (0, 0, foot / 2 + 0.02), (base.radius, foot / 2 - 0.02), "metal"),
        ("cylinder", (0, 0, 0.02), (0.9 * base.radius, 0.02), "rubber"),
        ("cylinder", (0, 0, top / 2), (0.35 * base.radius, top / 2), "metal"),
    ]
    return _visual_body(DRIVEN_BASE, parts)


def _visual_body(name: str, geoms: Iterable[Geom]) -> str:
    lines = [
        f'<geom class="visual" type="{kind}" pos="{_numbers(*pos)}" size="{_numbers(*size)}" material="scene/{material}"/>'
        for kind, pos, size, material in geoms
    ]
    return f'<body name="{name}" mocap="true">\n{_lines("  ", lines)}\n</body>'


def _cameras_and_lights(task: Task) -> str:
    """Return a camera that sees all tables from the side away from the robot, a key light at its left and a soft fill."""
    positions = np.array([table.position for table in task.tables])
    sizes = np.array([table.size for table in task.tables])
    low, high = (positions - sizes / 2).min(axis=0), (positions + sizes / 2).max(axis=0)
    centre = (low + high) / 2
    right, toward, up = np.array(task.right), np.array(task.away), np.array([0.0, 0.0, 1.0])
    width = abs(right @ (high - low))
    height = max(table.top for table in task.tables)
    target = np.array([centre[0], centre[1], height + 0.04 * width])  # there is more to see above the tables
    view = 0.8 * toward - 0.6 * up - 0.06 * right
    view /= np.linalg.norm(view)
    across = np.cross(view, up) / np.linalg.norm(np.cross(view, up))
    tangent = math.tan(math.radians(FIELD_OF_VIEW / 2))
    corners = np.array([[x, y, height] for x in (low[0], high[0]) for y in (low[1], high[1])]) - target
    distance = float(np.max(np.abs(corners @ across) / (FILLED * tangent) - corners @ view))  # all corners are in view
    eye = target - view * distance
    fovy = math.degrees(2 * math.atan(tangent * 9 / 16))
    key = target + width * (-0.6 * right - 0.45 * toward + 1.4 * up)
    fill = target + width * (0.9 * right - 0.5 * toward + 0.9 * up)
    axes = _numbers(*across, *np.cross(across, view))
    return f"""<camera name="overview" pos="{_numbers(*eye)}" xyaxes="{axes}" fovy="{fovy:.4g}"/>
<light type="directional" pos="{_numbers(*key)}" dir="{_numbers(*(target - key))}"
       diffuse=".56 .54 .50" specular=".2 .2 .2"/>
<light type="directional" pos="{_numbers(*fill)}" dir="{_numbers(*(target - fill))}"
       diffuse=".16 .17 .19" specular="0 0 0" castshadow="false"/>"""
