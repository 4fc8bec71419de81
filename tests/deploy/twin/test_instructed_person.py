"""A person who is told what to do, in a cell whose controller only keeps what is put where."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import box_poses, build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.instructed_person import InstructedPerson, Instruction, Pointer
from bt_jax.deploy.twin.person import tcp_points
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
ROOM = TASK.objects[0].height


NOW = TickReport(Observation(1.0, {}, {}, None), None, None, "acting")


def up(height):
    return np.array([0.0, 0.0, height])


class StillCell(Controller):
    """The part of the controller that a person uses, without its process."""

    def __init__(self, scene):
        self.scene, self.qpos = scene, scene.cell.qpos.copy()

    def state(self):
        return 0.0, self.qpos

    def put(self, body, pose):
        at = self.scene.model.jnt_qposadr[self.scene.model.body(body).jntadr[0]]
        self.qpos[at : at + 7] = [*pose.translation, *pose.rotation.as_quat(scalar_first=True)]


class Visit:
    """A cell with its person, and what the person has answered."""

    def __init__(self):
        self.scene = build_scene(YUMI, TASK, 0)
        self.cell, self.told, self.answers = StillCell(self.scene), [], []
        self.person = InstructedPerson(
            self.scene, self.cell, np.random.default_rng(0), self._taken, self.answers.append
        )

    def _taken(self):
        told, self.told = self.told, []
        return told

    def tell(self, *instructions):
        self.told += instructions
        return self.person(1.0, NOW)

    def place(self, box):
        return box_poses(self.scene, self.cell.qpos)[box].translation

    def seen_at(self, point):
        """Where the camera's picture shows a point of the world, in shares of its size."""
        camera = self.scene.camera
        x, y, depth = camera.matrix @ camera.pose.inv().apply(point)
        return ((x / depth + 0.5) / camera.width, (y / depth + 0.5) / camera.height)


@pytest.fixture
def visit():
    return Visit()


def test_the_camera_s_picture_is_pointed_at(visit):
    point = Pointer(visit.scene)
    for name in TASK.object_names:
        top = visit.place(name) + up(TASK.thing(name).height / 2)
        body, hit = point(visit.cell.qpos, visit.seen_at(top))
        assert body == name
        assert np.linalg.norm(hit - top) < 0.002
    table = TASK.tables[0]
    under = visit.place("YellowBox") * [1, 1, 0] + up(table.top)
    assert point(visit.cell.qpos, visit.seen_at(under), through="YellowBox")[0] == "world"


def test_a_push_moves_an_object_a_little_on_its_table(visit):
    before = {name: visit.place(name) for name in TASK.object_names}
    touch = visit.tell(Instruction("push", "GreenBox"))
    assert str(touch) == "a person pushes GreenBox"
    moved = {name: np.linalg.norm(visit.place(name) - place) for name, place in before.items()}
    assert moved["GreenBox"] == pytest.approx(0.05, abs=1e-3)
    assert moved["YellowBox"] == moved["BlueBox"] == 0
    assert visit.place("GreenBox")[2] == before["GreenBox"][2]


def test_what_is_taken_away_comes_back(visit):
    visit.tell(Instruction("remove", "BlueBox"))
    assert visit.person.away == ["BlueBox"]
    visit.tell(Instruction("push", "BlueBox"))
    assert visit.answers == ["BlueBox is away; bring it back first"]
    visit.tell(Instruction("return", "BlueBox"))
    assert visit.person.away == []
    assert [touch.what for touch in visit.person.touches] == ["remove", "return"]
    visit.tell(Instruction("return", "BlueBox"))
    assert visit.answers[1:] == ["BlueBox is not away; take it away first"]


def carry(visit, box, point):
    start = visit.seen_at(visit.place(box) + up(TASK.thing(box).height / 2))
    return visit.tell(Instruction("carry", start=start, end=visit.seen_at(point)))


def test_an_object_is_dragged_onto_another_into_the_kit_and_off_the_tables(visit):
    yellow = visit.place("YellowBox")
    carry(visit, "GreenBox", yellow + up(ROOM / 2))
    assert visit.place("GreenBox") == pytest.approx(yellow + up(ROOM), abs=0.003)
    visit.tell(Instruction("push", "YellowBox"))
    assert visit.answers == ["GreenBox stands on YellowBox; move that first"]
    kit = visit.scene.kit.translation
    carry(visit, "BlueBox", kit)
    assert visit.place("BlueBox")[:2] == pytest.approx(kit[:2], abs=0.003)
    carry(visit, "GreenBox", np.array([0.078, 0.0, 0.0]) + kit)
    assert visit.answers[1:] == ["the rim of KittingBox is there; choose a place inside or beside it"]
    start = visit.seen_at(visit.place("GreenBox") + up(ROOM / 2))
    visit.tell(Instruction("carry", start=start, end=(0.01, 0.99)))
    assert visit.person.away == ["GreenBox"]
    start = visit.seen_at(visit.place("YellowBox") + up(ROOM / 2))
    assert str(visit.tell(Instruction("carry", start=start, end=start))) == "a person pushes YellowBox"


def test_what_a_hand_is_near_is_left_alone(visit):
    tip = next(iter(tcp_points(visit.scene, visit.cell.qpos).values()))
    visit.cell.put("BlueBox", RigidTransform.from_translation(tip))
    visit.tell(Instruction("push", "BlueBox"), Instruction("remove", "Nothing"), Instruction("carry", end=(0.5, 0.5)))
    assert visit.answers == [
        "the robot's hand is at BlueBox; wait until it has gone",
        "there is no object 'Nothing'; choose one of YellowBox, GreenBox, BlueBox",
        "there is no object at that place of the picture; begin on one that you see",
    ]
    assert visit.person.touches == []
