import shutil
import subprocess
from html import unescape
from itertools import combinations
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from bt_jax.behaviors import Behavior, Control, Kind, expand
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text, to_dot
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import children, prefix
from tests.helpers.strategies import trees

SVG = "{http://www.w3.org/2000/svg}"
FONT = FontProperties(family="DejaVu Sans")
GENE = Behavior("move", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox"))
EXAMPLE = Control.sequence(GENE, Control.fallback(Behavior("gripper", ("open",)), Behavior("open_gripper")))


def label(node) -> str:
    return node.label if isinstance(node, Behavior) else {Kind.SEQUENCE: "→", Kind.FALLBACK: "?"}[node.kind]


def groups(root) -> list:
    return [group for group in root.iter(f"{SVG}g") if "node" in group.get("class", "").split()]


def extent(group) -> tuple[float, float, float, float]:
    shape = next(element for element in group if element.get("class") == "shape")
    if shape.tag == f"{SVG}rect":
        x, y, width, height = (float(shape.get(key)) for key in ("x", "y", "width", "height"))
        return x, y, x + width, y + height
    cx, cy, rx, ry = (float(shape.get(key)) for key in ("cx", "cy", "rx", "ry"))
    return cx - rx, cy - ry, cx + rx, cy + ry


def overlap(a, b) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


@pytest.fixture(scope="module")
def text_width():
    widths: dict[str, float] = {}

    def width(text: str) -> float:
        if text not in widths:
            widths[text] = TextPath((0, 0), text, size=13, prop=FONT).get_extents().width
        return widths[text]

    return width


def test_text_drawing():
    assert draw_text(EXAMPLE) == (
        "→\n├── move(YellowBox, (0, 0, 0.055), KittingBox)\n└── ?\n    ├── gripper(open)\n    └── open_gripper\n"
    )
    statuses = [Status.RUNNING, Status.SUCCESS, None, Status.FAILURE, Status.RUNNING]
    assert [line[:2] for line in draw_text(EXAMPLE, statuses).splitlines()] == ["… ", "✓ ", "  ", "✗ ", "… "]


@given(trees())
def test_text_drawing_has_one_line_for_each_node_in_prefix_order(tree):
    lines = draw_text(tree).splitlines()
    assert [line.lstrip("│├└─ ") for line in lines] == [label(node) for node in prefix(tree)]


@pytest.mark.parametrize("draw", [draw_text, to_svg])
def test_there_must_be_one_status_for_each_node(draw):
    with pytest.raises(ValueError, match="zip"):
        draw(EXAMPLE, [Status.SUCCESS])


@given(trees(), st.booleans())
def test_dot_has_the_nodes_and_the_edges(tree, expand_genes):
    source = to_dot(tree, expand_genes=expand_genes)
    nodes = prefix(expand(tree) if expand_genes else tree)
    for i, node in enumerate(nodes):
        assert f'  n{i} [label="{label(node)}" id="node-{i}"' in source
        assert source.count(f"  n{i} -> ") == len(children(node))
    assert source.count(" -> ") == len(nodes) - 1


@pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
def test_graphviz_reads_the_source():
    source = to_dot(EXAMPLE, expand_genes=True)
    drawn = subprocess.run(["dot", "-Tsvg"], input=source, capture_output=True, text=True, check=True).stdout
    assert 'id="node-0"' in unescape(drawn)


@given(trees(max_leaves=8), st.data())
def test_svg_numbers_the_nodes_and_shows_their_statuses(tree, data):
    nodes = prefix(tree)
    statuses = [data.draw(st.sampled_from([None, *Status])) for _ in nodes]
    for expand_genes in (False, True):
        found = {
            group.get("id"): group
            for group in groups(ElementTree.fromstring(to_svg(tree, statuses, expand_genes=expand_genes)))
        }
        for i, (node, status) in enumerate(zip(nodes, statuses, strict=True)):
            group = found[f"node-{i}"]
            drawn = node.subtree if expand_genes and node.kind == Kind.GENE else node
            kind = drawn.kind.name.lower()
            assert group.get("class") == f"node {kind} {'idle' if status is None else status.name.lower()}"
            if not expand_genes:
                assert " ".join(text.text for text in group.iter(f"{SVG}text")) == label(node)
        assert len(found) == len(prefix(expand(tree) if expand_genes else tree))


@given(trees(max_leaves=8), st.booleans())
def test_svg_nodes_do_not_overlap_and_lie_inside_the_picture(tree, expand_genes):
    root = ElementTree.fromstring(to_svg(tree, title="A title", expand_genes=expand_genes))
    extents = [extent(group) for group in groups(root)]
    assert not any(overlap(a, b) for a, b in combinations(extents, 2))
    left, top, width, height = map(float, root.get("viewBox").split())
    (shifted,) = [group for group in root if group.get("transform")]
    x, y = map(float, shifted.get("transform").removeprefix("translate(").removesuffix(")").split())
    for a in extents:
        assert left <= a[0] + x
        assert top + 30 <= a[1] + y
        assert a[2] + x <= width
        assert a[3] + y <= height


@given(trees(max_leaves=8))
def test_svg_children_stand_below_their_parent_from_left_to_right(tree):
    extents = iter([extent(group) for group in groups(ElementTree.fromstring(to_svg(tree)))])

    def visit(node):
        mine = next(extents)
        below = [visit(child) for child in children(node)]
        centers = [(a[0] + a[2]) / 2 for a in below]
        assert centers == sorted(centers)
        assert all(a[1] > mine[3] for a in below)
        if below:
            assert (mine[0] + mine[2]) / 2 == pytest.approx((centers[0] + centers[-1]) / 2, abs=0.1)
        return mine

    visit(tree)


@given(tree=trees(max_leaves=8))
def test_svg_frames_hold_their_gene_and_nothing_else(tree):
    root = ElementTree.fromstring(to_svg(tree, expand_genes=True))
    extents = {group.get("id"): extent(group) for group in groups(root)}
    genes = [i for i, node in enumerate(prefix(tree)) if node.kind == Kind.GENE]
    frames = [element for element in root.iter(f"{SVG}rect") if element.get("class") == "frame"]
    assert len(frames) == len(genes)
    for i, frame in zip(genes, frames, strict=True):
        x, y, width, height = (float(frame.get(key)) for key in ("x", "y", "width", "height"))
        for name, inner in extents.items():
            belongs = name == f"node-{i}" or name.startswith(f"node-{i}-")
            assert overlap(inner, (x, y, x + width, y + height)) == belongs


def test_svg_labels_fit_their_nodes(text_width):
    leaves = ["reached(unstacked)", "WWWWWWWWWWWWWWWWWWWWWWWW"]
    wide = Behavior("move", ("TheLargestBoxOfTheFactory", (-0.133, -0.266, 0.1234567), "WideKittingBox"))
    tree = Control.sequence(
        *prefix(EXAMPLE)[1:], wide, Behavior("reached", (leaves[0],)), Behavior("pick", (leaves[1],))
    )
    for group in groups(ElementTree.fromstring(to_svg(tree))):
        a = extent(group)
        ellipse = any(element.tag == f"{SVG}ellipse" for element in group)
        for text in group.iter(f"{SVG}text"):
            y = float(text.get("y"))
            assert a[1] < y - 10
            assert y + 3 < a[3]
            away = abs(y - 4.5 - (a[1] + a[3]) / 2) / ((a[3] - a[1]) / 2)
            room = (a[2] - a[0]) * ((1 - away**2) ** 0.5 if ellipse else 1)
            assert text_width(text.text) < room - 4


def test_svg_escapes_what_it_is_given():
    root = ElementTree.fromstring(to_svg(Behavior("pick", ("<&>",)), title='"<Kit> & co"'))
    assert root.find(f"{SVG}title").text == '"<Kit> & co"'
    assert "pick(<&>)" in [text.text for text in root.iter(f"{SVG}text")]


def test_nodes_that_arrays_do_not_hold_are_drawn():
    tree = parse_tree(
        "ResumingSequence(Inverter(gripper(open)), Timeout(5000, pick(A)), subtask(s, ForceSuccess(pick(A))))"
    )
    assert draw_text(tree).splitlines() == [
        "→*",
        "├── Inverter",
        "│   └── gripper(open)",
        "├── Timeout 5000 ms",
        "│   └── pick(A)",
        "└── s",
    ]
    assert 'label="Timeout 5000 ms" id="node-3" shape=box' in to_dot(tree)
    for drawing in (to_svg(tree), to_svg(tree, expand_genes=True), to_svg(tree, folded={"node-1"})):
        root = ElementTree.fromstring(drawing)
        classes = {node.get("id"): node.get("class") for node in root.iter() if node.get("id")}
        assert classes["node-0"].startswith("node extended")
        assert "→*" in drawing
        assert "Inverter" in drawing


def test_decorators_that_count_ticks_are_drawn_with_their_numbers():
    tree = parse_tree("retry(3, timeout(5, look(A)))")
    assert draw_text(tree).splitlines() == ["retry 3", "└── timeout 5 ticks", "    └── look(A)"]
    for drawing in (to_svg(tree), to_dot(tree)):
        assert "retry 3" in drawing
        assert "timeout 5 ticks" in drawing
