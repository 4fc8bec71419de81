from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind, expand
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.encoding.walk import prefix
from tests.helpers.strategies import GENES, trees

PICK = Behavior("pick", ("YellowBox",))
MOVE = '<SubTree ID="Move" object="YellowBox" position="0;0;0.1" frame="KittingBox"/>'


def document(body: str, rest: str = "", main: str = "Main") -> str:
    start = f'<root BTCPP_format="4" main_tree_to_execute="{main}">\n<BehaviorTree ID="Main">'
    return f"{start}\n{body}\n</BehaviorTree>{rest}</root>"


@given(trees())
def test_genes_round_trip(tree):
    assert from_xml(to_xml(tree)) == tree


@given(trees())
def test_expanded_genes_round_trip_to_the_expanded_tree(tree):
    assert from_xml(to_xml(tree, expand_genes=True)) == expand(tree)


@given(trees(GENES))
def test_the_tree_of_a_gene_does_what_the_gene_does(tree):
    other_name = to_xml(tree).replace('ID="Move"', 'ID="Shift"')
    assert from_xml(other_name) == expand(tree)


@given(trees(), st.booleans())
def test_documents_keep_the_rules_of_behaviortree_cpp(tree, expand_genes):
    root = ElementTree.fromstring(to_xml(tree, name="Kit-1", expand_genes=expand_genes))
    assert root.tag == "root"
    assert root.attrib == {"BTCPP_format": "4", "main_tree_to_execute": "Kit-1"}
    (models,) = root.findall("TreeNodesModel")
    ports = {model.get("ID"): {port.get("name") for port in model.findall("input_port")} for model in models}
    kinds = {model.get("ID"): model.tag for model in models}
    definitions = {element.get("ID"): element for element in root.findall("BehaviorTree")}
    assert "Kit-1" in definitions
    assert set(definitions) - {"Kit-1"} == {e.get("ID") for e in root.iterfind(".//BehaviorTree//SubTree")}
    for definition in definitions.values():
        assert len(definition) == 1
        for element in definition.iterfind(".//*"):
            name = element.get("ID", element.tag)
            if name.startswith("Reactive"):
                assert name in ("ReactiveSequence", "ReactiveFallback")
                assert len(element) > 0
                assert not element.attrib
            else:
                assert len(element) == 0
                assert (element.tag == "SubTree") == (kinds[name] == "SubTree")
                assert set(element.attrib) - {"ID"} == ports[name]
    if expand_genes:
        assert set(definitions) == {"Kit-1"}


def test_number_of_nodes_is_kept():
    gene = GENES[-1]
    tree = Control.sequence(gene, PICK)
    root = ElementTree.fromstring(to_xml(tree, expand_genes=True))
    assert len(list(root.find("BehaviorTree").iter())) - 1 == len(prefix(expand(tree))) == 2 + len(prefix(gene.subtree))


def test_reads_a_file(tmp_path):
    path = tmp_path / "tree.xml"
    path.write_text(to_xml(GENES[-1]), encoding="utf-8")
    assert from_xml(path) == from_xml(str(path)) == GENES[-1]


def test_subtrees_are_inlined_with_their_ports():
    rest = """
      <BehaviorTree ID="Fetch"><ReactiveSequence>
        <Holding object="{what}"/><SubTree ID="Leave" object="{what}"/>
        <SubTree ID="Leave" _autoremap="true" object="{=}"/>
      </ReactiveSequence></BehaviorTree>
      <BehaviorTree ID="Leave"><Pick object="{object}"/></BehaviorTree>"""
    tree = from_xml(document('<SubTree ID="Fetch" what="YellowBox" object="BlueBox"/>', rest))
    assert tree == Control.sequence(Behavior("holding", ("YellowBox",)), PICK, Behavior("pick", ("BlueBox",)))


def test_a_gene_that_was_edited_is_read_as_edited():
    definition = '<BehaviorTree ID="Move"><Pick object="{object}"/></BehaviorTree>'
    assert from_xml(document(MOVE, definition)) == PICK
    assert from_xml(document(MOVE)).kind == Kind.GENE


def test_explicit_tags_and_names_are_read():
    body = '<Control ID="ReactiveFallback" name="x"><Action ID="Pick" name="y" object=" YellowBox "/></Control>'
    assert from_xml(document(body)) == Control.fallback(PICK)


def test_the_only_tree_is_the_main_one():
    assert from_xml('<root BTCPP_format="4"><BehaviorTree><Pick object="YellowBox"/></BehaviorTree></root>') == PICK


def test_what_behaviortree_cpp_writes_is_read():
    """It repeats a definition for each SubTree that uses it, drops which tree is the main one, and names every node."""
    move = """<BehaviorTree ID="Move" _fullpath="Move::{}">
      <Pick name="Pick {}" object="{{object}}"/>
    </BehaviorTree>"""
    text = f"""<root BTCPP_format="4">
    {move.format(1, "a")}
    <BehaviorTree ID="MainTree" _fullpath="">
      <ReactiveSequence name="ReactiveSequence">
        <SubTree ID="Move" frame="KittingBox" position="0;0;0.1" object="YellowBox" _autoremap="false"/>
        <SubTree ID="Move" frame="KittingBox" position="0;0;0.1" object="BlueBox"/>
      </ReactiveSequence>
    </BehaviorTree>
    {move.format(2, "b")}
    <TreeNodesModel/></root>"""
    assert from_xml(text) == Control.sequence(PICK, Behavior("pick", ("BlueBox",)))


EXTENDED_XML = """<Sequence><SequenceWithMemory><OpenGripper/></SequenceWithMemory><Fallback>
  <Inverter><ForceSuccess><ForceFailure><OpenGripper/></ForceFailure></ForceSuccess></Inverter>
  <Decorator ID="RetryUntilSuccessful" num_attempts="{times}"><Repeat num_cycles="2"><Timeout msec="5000">
  <KeepRunningUntilFailure name="k"><OpenGripper/></KeepRunningUntilFailure></Timeout></Repeat></Decorator>
</Fallback></Sequence>"""


def test_nodes_that_arrays_do_not_hold_round_trip():
    rest = f'<BehaviorTree ID="Other">{EXTENDED_XML}</BehaviorTree>'
    tree = from_xml(document('<SubTree ID="Other" times="-1"/>', rest))
    assert str(tree) == (
        "ResumingSequence(SequenceWithMemory(open_gripper), ResumingFallback(Inverter(ForceSuccess(ForceFailure("
        "open_gripper))), RetryUntilSuccessful(-1, Repeat(2, Timeout(5000, KeepRunningUntilFailure(open_gripper))))))"
    )
    assert from_xml(to_xml(tree)) == tree


def test_decorators_that_count_ticks_round_trip():
    """They have tags of their own, since BehaviorTree.CPP has no node of that meaning, and a model that says so."""
    tree = Control.sequence(ExtendedNode("retry", (ExtendedNode("timeout", (PICK,), 5),), 3), Behavior("look", ("A",)))
    text = to_xml(tree)
    assert from_xml(text) == tree
    assert '<RetryOverTicks num_attempts="3">' in text
    assert '<TimeoutInTicks num_ticks="5">' in text
    assert '<Decorator ID="TimeoutInTicks" editable="true">' in text
    assert "Decorator" not in to_xml(PICK)
    changed = text.replace('num_ticks="5"', 'num_ticks="0"')
    with pytest.raises(UserError, match="line 6: timeout: num_ticks cannot be 0; give 1 to 255"):
        from_xml(changed)


def test_a_subtask_that_remembers_is_read_as_its_tree():
    rest = '<BehaviorTree ID="Subtask_a"><Repeat num_cycles="2"><OpenGripper/></Repeat></BehaviorTree>'
    assert str(from_xml(document('<SubTree ID="Subtask_a"/>', rest))) == "Repeat(2, open_gripper)"


@pytest.mark.parametrize("declared", ["utf-16", "UTF-16LE", "utf-32"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_wide_encodings_may_be_declared_in_a_file_that_another_program_has_saved(tmp_path, declared, encoding):
    text = f'<?xml version="1.0" encoding="{declared}"?>\n<!-- 取 -->' + document('<Pick object="YellowBox"/>')
    path = tmp_path / "tree.xml"
    path.write_bytes(text.encode(encoding))
    assert from_xml(path) == Behavior("pick", ("YellowBox",))


@pytest.mark.parametrize("encoding", ["gb2312", "shift_jis", "windows-1252", "UTF-8", "utf-16", "utf-16-le"])
def test_encodings_that_python_knows_are_read(tmp_path, encoding):
    remark = {"windows-1252": "Größe"}.get(encoding, "取")
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n<!-- {remark} -->' + document('<Pick object="YellowBox"/>')
    path = tmp_path / "tree.xml"
    path.write_bytes(text.encode(encoding))
    assert from_xml(path) == PICK


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            b'<?xml version="1.0" encoding="utf8mb4"?><root/>',
            "tree.xml: its encoding 'utf8mb4' is not known; save",
        ),
        (b'<?xml version="1.0" encoding="hex"?><root/>', "its encoding 'hex' is not known; save"),
        (b'<?xml version="1.0" encoding="UTF-8"?>\n<!-- \xe4 --><root/>', "'UTF-8' does not fit the text; save it"),
        (b"<root>\n\xe4</root>", "tree.xml, line 2: not UTF-8 text; save the file as UTF-8"),
    ],
)
def test_other_encodings_are_refused(tmp_path, data, message):
    path = tmp_path / "tree.xml"
    path.write_bytes(data)
    with pytest.raises(UserError) as error:
        from_xml(path)
    assert message in str(error.value)


@given(trees(max_leaves=6), st.data())
def test_damaged_documents_are_read_or_refused_for_the_user(tree, data):
    text = to_xml(tree)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, len(text)))
    try:
        damaged = from_xml(text[:start] + text[end:])
    except UserError:
        return
    assert from_xml(to_xml(damaged)) == damaged


TWICE = '<SubTree ID="{0}"/><SubTree ID="{0}"/>'
BOMB = (
    "".join(
        f'<BehaviorTree ID="T{i}"><ReactiveSequence>{TWICE.format(f"T{i + 1}")}</ReactiveSequence></BehaviorTree>'
        for i in range(14)
    )
    + '<BehaviorTree ID="T14"><OpenGripper/></BehaviorTree>'
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no/such.xml", "there is no file no/such.xml; check the path"),
        ("<root>\n<a></b></root>", "XML, line 2: not XML (mismatched tag); fix"),
        ("<root/>", 'must start with <root BTCPP_format="4">'),
        ('<root BTCPP_format="3"/>', 'must start with <root BTCPP_format="4">'),
        ('<root BTCPP_format="4"/>', "there is no <BehaviorTree>; add one"),
        (
            document("<OpenGripper/>", main="Other"),
            "line 1: there is no main tree 'Other'; set main_tree_to_execute to",
        ),
        (
            '<root BTCPP_format="4"><BehaviorTree ID="A"/><BehaviorTree ID="B"><SubTree ID="C"/></BehaviorTree>'
            '<BehaviorTree ID="C"/></root>',
            "which tree is the main one? set main_tree_to_execute to one of A, B",
        ),
        (
            document("<OpenGripper/>", '<BehaviorTree ID="Main"/>'),
            "a second, different <BehaviorTree> has the ID 'Main'",
        ),
        (document("", '<include path="x"/>'), "<include> is not supported; copy"),
        (document(""), "line 2: <BehaviorTree ID='Main'> has 0 nodes at its top; it must have one"),
        (document("<Jump/>"), "line 3: unknown node <Jump>; use one of ReactiveSequence"),
        (
            document("<RecoveryNode number_of_retries='1'>\n<Jump/><Jump/><Pick object='A'/>\n<Hop/></RecoveryNode>"),
            "line 3: unknown nodes <RecoveryNode>, <Jump> (line 4), <Hop> (line 5); use <RetryUntilSuccessful> around a "
            "<Fallback> in place of <RecoveryNode>, one of ReactiveSequence",
        ),
        (
            document("<Parallel><OpenGripper/></Parallel>"),
            "unknown node <Parallel>; use <ReactiveSequence>, one action",
        ),
        (document("<Sequence/>"), "line 3: ResumingSequence has no children; give it some"),
        (document("<Inverter><OpenGripper/><OpenGripper/></Inverter>"), "line 3: Inverter has 2 children; give it one"),
        (document("<Repeat><OpenGripper/></Repeat>"), '<Repeat> lacks the port num_cycles; add num_cycles="..."'),
        (document("<Repeat num_cycles='0'><OpenGripper/></Repeat>"), "num_cycles cannot be 0; give 1 to"),
        (document("<Timeout msec='1e3'><OpenGripper/></Timeout>"), "'1e3' is not a whole number; correct msec"),
        (document("<Inverter depth='1'><OpenGripper/></Inverter>"), "<Inverter> has no port depth; delete it"),
        (document("<ReactiveSequence/>"), "line 3: <ReactiveSequence> has no children; add"),
        (
            document("<OpenGripper><OpenGripper/></OpenGripper>"),
            "<OpenGripper> takes no nodes inside it; put both into a <ReactiveSequence>",
        ),
        (document("<Pick/>"), 'line 3: <Pick> lacks the port object; add object="..."'),
        (document('<Pick object="A" color="red"/>'), "<Pick> has no port color; delete it or use object"),
        (document('<OpenGripper _skipIf="x"/>'), "the script in _skipIf is not supported; write"),
        (document("<Action/>"), "<Action> has no ID; add it"),
        (document('<Gripper opening="ajar"/>'), "line 3: gripper(ajar) is unknown; write"),
        (document('<At object="A" position="0,0,1" frame="B"/>'), "'0,0,1' is not a position; write three numbers"),
        (document('<At object="A" position="0;0;inf" frame="B"/>'), "'0;0;inf' is not a position"),
        (document('<Pick object="{box}"/>'), 'no value for object="{box}"; give'),
        (document('<SubTree ID="Other"/>'), "there is no <BehaviorTree ID='Other'>; add it"),
        (document('<SubTree ID="Main"/>'), "the tree Main contains itself (Main > Main); break the circle"),
        (document('<SubTree ID="T0"/>', BOMB), "nodes, SubTrees written out; make it smaller"),
        (
            document("<ReactiveSequence>" * 3000 + "</ReactiveSequence>" * 3000),
            "the tree is nested too deeply; make it flatter",
        ),
        (
            document("<Inverter>" * 150 + "<OpenGripper/>" + "</Inverter>" * 150),
            "XML: the tree is nested too deeply; make",
        ),
    ],
)
def test_errors_say_where_why_and_what_to_do(text, message):
    with pytest.raises(UserError) as error:
        from_xml(text)
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["", "Pick", "Move", "ReactiveSequence", "a b", "1st", "x/y"])
def test_names_that_behaviortree_cpp_refuses(name):
    with pytest.raises(UserError, match="cannot name a tree"):
        to_xml(PICK, name=name)
