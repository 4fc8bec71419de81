import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.reach_memory import ReachMemory
from tests.helpers.ideal import IdealSkills


class Asked(IdealSkills):
    """Reaches as far as 0.5 m."""

    def __init__(self):
        super().__init__(None, None, None)
        self.count = 0

    def reachable(self, name, seen):
        self.count += 1
        return bool(seen.poses[name].translation[0] < 0.5)


def seen(**x):
    poses = {name: RigidTransform.from_translation([place, 0, 0]) for name, place in x.items()}
    return Observation(0.0, poses, {}, None)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_the_answer_is_that_of_the_last_place_that_differed(places):
    skills = Asked()
    memory = ReachMemory(skills, ["a"])
    asked = None
    count = 0
    for place in places:
        if asked is None or abs(place - asked) >= 0.005:
            asked, count = place, count + 1
        assert memory.unreachable(seen(a=place), ask=True) == (frozenset() if asked < 0.5 else {"a"})
        assert skills.count == count


def test_what_was_never_seen_counts_as_within_reach():
    skills = Asked()
    memory = ReachMemory(skills, ["a", "b"])
    assert memory.unreachable(seen(b=0.9), ask=True) == {"b"}
    assert memory.known_unreachable() == ["b"]


def test_nothing_is_found_out_during_an_attempt():
    skills = Asked()
    memory = ReachMemory(skills, ["a"])
    assert memory.unreachable(seen(a=0.9), ask=False) == frozenset()
    memory.unreachable(seen(a=0.9), ask=True)
    assert memory.unreachable(seen(a=np.float64(0.1)), ask=False) == {"a"}
    assert skills.count == 1
