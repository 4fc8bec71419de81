"""Ten trees with their text, XML, arrays and one tick each, as `tests/data/golden_trees.json` holds them: no format has
changed, and other programs have something to test theirs against.

`text` and `given`, the status of each leaf, are the input; `--rewrite-golden` writes all that follows from them again.
"""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax.behaviors import Vocabulary, parse_behavior
from bt_jax.encoding import (
    Status,
    Trees,
    decode,
    encode,
    format_tree,
    from_xml,
    jump_table,
    leaves,
    one_line,
    parse_tree,
    tick_tree,
    tick_trees,
    to_xml,
)

GOLDEN = Path(__file__).parents[1] / "data" / "golden_trees.json"
NUM_NODES = 24
KNOWN = json.loads(GOLDEN.read_text())


def described(text: str, given: dict[str, str]) -> dict[str, Any]:
    """All that follows from a tree and the statuses of its leaves."""
    tree = parse_tree(text)
    vocabulary = Vocabulary.of(leaves(tree))
    trees = encode(tree, vocabulary, NUM_NODES)
    ticked = tick_tree(tree, lambda leaf, _: Status[given[str(leaf)]])
    return {
        "text": text,
        "lines": format_tree(tree).splitlines(),
        "xml": to_xml(tree).splitlines(),
        "vocabulary": list(map(str, vocabulary.leaves)),
        "tokens": trees.tokens.tolist(),
        "sizes": trees.sizes.tolist(),
        "given": given,
        "ticked": [None if status is None else status.name for status in ticked.statuses],
    }


def test_the_file_is_written_again(request):
    if request.config.getoption("--rewrite-golden"):
        found = {name: described(golden["text"], golden["given"]) for name, golden in KNOWN.items()}
        GOLDEN.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    assert len(KNOWN) == 10


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_written_is_unchanged(name):
    assert described(KNOWN[name]["text"], KNOWN[name]["given"]) == KNOWN[name]


@pytest.mark.parametrize("name", KNOWN)
def test_every_form_is_read_back(name):
    golden = KNOWN[name]
    tree = parse_tree(golden["text"])
    assert one_line(tree) == golden["text"]
    assert parse_tree("\n".join(golden["lines"])) == tree
    assert from_xml("\n".join(golden["xml"])) == tree
    vocabulary = Vocabulary.of(map(parse_behavior, golden["vocabulary"]))
    trees = encode(tree, vocabulary, NUM_NODES)
    assert decode(trees, vocabulary) == tree


def test_a_population_ticks_as_each_tree_alone():
    """All ten at once, over the arrays of the file."""
    tokens, sizes = (np.array([golden[key] for golden in KNOWN.values()]) for key in ("tokens", "sizes"))
    statuses = np.zeros((10, 3 + max(len(golden["vocabulary"]) for golden in KNOWN.values())), np.int8)
    for row, golden in zip(statuses, KNOWN.values(), strict=True):
        row[3 : 3 + len(golden["vocabulary"])] = [Status[golden["given"][leaf]] for leaf in golden["vocabulary"]]
    table, known = jump_table(Trees(tokens.astype(np.int16), sizes.astype(np.uint8))), jnp.asarray(statuses)
    ticked = tick_trees(table, lambda token: known[jnp.arange(10), token], trace=True)
    assert [Status(status).name for status in ticked.status] == [golden["ticked"][0] for golden in KNOWN.values()]
    for visited, golden in zip(np.asarray(ticked.visited), KNOWN.values(), strict=True):
        leaf = [token > 2 for token in golden["tokens"]]
        shown = [status is not None for status in golden["ticked"]]
        assert visited.nonzero()[0].tolist() == [i for i, there in enumerate(shown) if there and leaf[i]]
