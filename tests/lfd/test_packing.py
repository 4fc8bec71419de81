import itertools

from hypothesis import given
from hypothesis import strategies as st

from bt_jax.lfd.packing import best_packing

groups = st.frozensets(st.integers(0, 7), min_size=1, max_size=5)


@given(values=st.dictionaries(groups, st.integers(1, 20).map(float), max_size=6))
def test_no_other_disjoint_groups_are_worth_more(values):
    found = best_packing(values)
    assert sum(map(len, found)) == len(frozenset().union(*found))
    disjoint = [
        chosen
        for count in range(len(values) + 1)
        for chosen in itertools.combinations(values, count)
        if sum(map(len, chosen)) == len(frozenset().union(*chosen))
    ]
    assert sum(values[group] for group in found) == max(sum(map(values.get, chosen)) for chosen in disjoint)


def test_many_members_are_no_problem():
    values = {frozenset(range(i, i + 3)): 3.0 for i in range(3000)}
    assert len(best_packing(values)) == 1000
