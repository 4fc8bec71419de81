"""A sparse matrix against a dict, up to the largest that the package is made for."""

import jax
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.mjx_env.episodes.pages import PAGE, UNKNOWN, Pages, SparseRows

FIRST, MORE, COMMANDS, SIZE = 16, 40, 2 * PAGE + 5, 32
PAIRS = st.tuples(st.integers(0, MORE - 1), st.integers(0, COMMANDS - 1))
look_up = jax.jit(Pages.at)
BATCH = st.dictionaries(PAIRS, st.integers(-2, MORE), max_size=SIZE)


def enter(rows, batch):
    states, commands = np.array(list(batch), np.int32).reshape(-1, 2).T
    assert rows.has_room(states, commands)
    rows.enter(states, commands, np.array(list(batch.values()), np.int32), SIZE)


def looked_up(rows, states, commands):
    return np.asarray(look_up(rows.pages, states.astype(np.int32), commands.astype(np.int32)))


def assert_holds(rows, expected, states):
    every = np.indices((states, COMMANDS)).reshape(2, -1)
    known = [expected.get(pair, UNKNOWN) for pair in zip(*every.tolist(), strict=True)]
    np.testing.assert_array_equal(looked_up(rows, *every), known)


@given(BATCH, BATCH, BATCH)
def test_it_holds_what_a_dict_holds(before, after, again):
    rows = SparseRows(COMMANDS, FIRST)
    few = {(state % FIRST, command): value for (state, command), value in before.items()}
    few = dict(list(few.items())[:FIRST])
    enter(rows, few)
    assert_holds(rows, few, FIRST)
    rows.grow(MORE)
    later = dict(list(after.items())[: MORE - FIRST])
    enter(rows, later)
    assert_holds(rows, few | later, MORE)
    rows.forget()
    enter(rows, again)
    assert_holds(rows, again, MORE)


def test_it_says_when_no_page_is_left():
    rows = SparseRows(COMMANDS, FIRST)
    states, one = np.arange(FIRST, dtype=np.int32), np.ones(FIRST, np.int32)
    assert rows.has_room(states, one)
    rows.enter(states, one, states, SIZE)
    assert rows.has_room(states, one + 1)  # in the same pages
    assert not rows.has_room(states[:1], one[:1] + PAGE)
    rows.grow(MORE)
    assert rows.has_room(states, one + PAGE)


@given(st.integers(1, 20_000))
def test_an_index_of_32_bits_numbers_all_that_it_has_room_for(commands):
    states = SparseRows.most_states(commands)
    blocks = -(-commands // PAGE)
    assert max(states * blocks, (1 + states) * PAGE) <= np.iinfo(np.int32).max
    assert max((1 + states) * blocks, (2 + states) * PAGE) > np.iinfo(np.int32).max


def test_sixteen_objects_in_four_trays_fit():
    """Places of each object: on each other one, at four sides of it, and in 16 slots of each tray. A dense matrix would have
    more than 2^31 entries, 9 GB."""
    commands, states = 2 + 16 + 16 * (15 * 5 + 4 * 16), 1_000_000
    assert commands * states > 2**31
    rows, rng = SparseRows(commands, states), np.random.default_rng(0)
    keys = np.unique(np.append(rng.integers(0, commands * states, states - 1), commands * states - 1))
    values = rng.integers(-2, states, len(keys)).astype(np.int32)
    where = [part.astype(np.int32) for part in np.divmod(keys, commands)]
    for first in range(0, len(keys), 1 << 15):
        part = slice(first, first + (1 << 15))
        rows.enter(where[0][part], where[1][part], values[part], 1 << 15)
    assert rows.nbytes <= states * SparseRows.bytes_per_state(commands) + PAGE * 4 < 1 << 30

    known = dict(zip(keys.tolist(), values.tolist(), strict=True))
    others = rng.integers(0, commands * states, 100_000)
    near = np.minimum(keys[::10] + rng.integers(1, 3, len(keys[::10])), commands * states - 1)
    asked = np.concatenate([keys, others, near])
    expected = np.array([known.get(key, UNKNOWN) for key in asked.tolist()])
    np.testing.assert_array_equal(looked_up(rows, *np.divmod(asked, commands)), expected)
