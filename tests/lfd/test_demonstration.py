import numpy as np
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bt_jax.lfd import Action, Demonstration, DemonstrationFolder, Pose
from tests.helpers.demonstrations import FRAMES

numbers = st.floats(-5, 5).map(lambda x: round(x, 5) + 0.0)


vectors = st.tuples(numbers, numbers, numbers)


turns = st.lists(st.tuples(vectors, vectors), min_size=len(FRAMES.names), max_size=len(FRAMES.names))


def pose(position, rotation):
    return Pose(
        position, tuple(round(float(x), 5) + 0.0 for x in Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    )


def demonstration(of_actions):
    """Picks and places in turn, with a position and a rotation vector for each frame."""
    return Demonstration(
        "",
        tuple(
            Action(
                kind,
                {frame: pose(*one) for frame, one in zip(FRAMES.names, given, strict=True)}
                | ({"BlueBox": Pose((0.01, 0.0, 0.12))} if kind == "pick" else {}),
            )
            for kind, given in zip(["pick", "place"] * 3, of_actions, strict=False)
        ),
    )


def test_files_have_quaternions_xyzw_and_poses_wxyz(tmp_path):
    turned = pose((0.1, 0.2, 0.3), (0.0, 0.0, 1.0))
    actions = tuple(Action(kind, dict.fromkeys(FRAMES.names, turned)) for kind in ("pick", "place"))
    made = DemonstrationFolder(tmp_path / "made")
    made.create(FRAMES)
    made.append(Demonstration("", actions))
    written = yaml.safe_load((made.path / "demo1" / "data_1.yaml").read_text())["vec_quat"]["BlueBox"]
    np.testing.assert_allclose(written, Rotation.from_rotvec((0.0, 0.0, 1.0)).as_quat(), atol=1e-5)
    assert made.read().demonstrations[0].actions[0].poses["BlueBox"] == turned


@settings(max_examples=15)
@given(
    drawn=st.lists(
        st.lists(turns, min_size=2, max_size=6).filter(lambda one: len(one) % 2 == 0), min_size=1, max_size=3
    )
)
def test_what_is_written_is_read(tmp_path_factory, drawn):
    given = [demonstration(one) for one in drawn]
    folder = DemonstrationFolder(tmp_path_factory.mktemp("set"))
    folder.create(FRAMES)
    written = [folder.append(one) for one in given]
    read = folder.read()
    assert read.frames == FRAMES
    assert read.problems == ()
    assert list(read) == written
    assert [one.actions for one in read] == [one.actions for one in given]
    assert [one.name for one in read] == [f"demo{i}" for i in range(1, len(given) + 1)]


@given(position=vectors, rotation=vectors, point=vectors)
def test_a_pose_turns_as_scipy_does(position, rotation, point):
    expected = Rotation.from_rotvec(rotation).apply(point) + position
    np.testing.assert_allclose(pose(position, rotation).apply(point), expected, atol=5e-4)  # quaternions are rounded


def test_the_inverse_of_a_pose_undoes_it():
    pose = Pose((0.3, -0.2, 0.7), (0.5, 0.5, -0.5, 0.5))
    np.testing.assert_allclose(pose.inverse().apply(pose.apply((1.0, 2.0, 3.0)).tolist()), (1, 2, 3), atol=1e-12)
