import contextlib
import json

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.tasks import load_task, problems, task_from_dict, task_names, task_of_folder

LAST = "\ntargets: [{object: YellowBox, position: [0, 0, 0.052], frame: KittingBox}]\n"


@pytest.mark.parametrize("name", task_names())
def test_tasks_survive_json_and_yaml(name):
    task = load_task(name)
    assert task.name == name
    data = task.to_dict()
    assert task_from_dict(json.loads(json.dumps(data)), source="json") == task
    assert task_from_dict(yaml.safe_load(yaml.safe_dump(data)), source="yaml") == task
    assert hash(task) == hash(load_task(name))


def test_the_published_scene():
    task = load_task("stack")
    assert [table.top for table in task.tables] == [0.75, 0.75, 0.75]
    assert [table.position[0] for table in task.tables] == [-1, 0, 1]
    assert task.frames == ("YellowBox", "GreenBox", "BlueBox", "KittingBox", "base_link")
    assert load_task("restack").layout.stack == ("YellowBox", "BlueBox", "GreenBox")
    assert load_task("restack").targets == load_task("stack3").targets


def test_a_file_says_what_differs(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: pyramid\nname: mine\nweights: {node: 5}\n")
    mine, base = load_task(path), load_task("pyramid")
    assert mine.targets == base.targets
    assert mine.weights.node == 5
    assert mine.weights.distance == base.weights.distance
    (tmp_path / "other.yaml").write_text("extends: mine.yaml\nname: other\n")
    assert load_task(tmp_path / "other.yaml").weights == mine.weights


def test_a_description_is_not_inherited(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: stack\nname: mine\n")
    assert (load_task(path).description, load_task(path).title) == ("", "mine")
    path.write_text("extends: stack\nname: mine\ndescription: Two boxes.\n")
    assert load_task(path).title == "mine: Two boxes."


def target(**over):
    return {"targets": [{"object": "YellowBox", "position": [0, 0, 0.052], "frame": "KittingBox"} | over]}


def boxes(**over):
    names = ("YellowBox", "GreenBox", "BlueBox")
    return {"boxes": [{"name": name, "size": 0.1, "color": [1, 0, 0]} | over for name in names]}


def in_frame(**frames):
    return {"targets": [{"object": o, "position": [0, 0, 0.1], "frame": f} for o, f in frames.items()]}


def fixed(*places, kit="TableRight", **over):
    entries = [{"object": o, "position": p, "frame": "base_link"} | over for o, p in places]
    return {"layout": {"kit": kit, "fixed": entries}}


@pytest.mark.parametrize(
    ("change", "key", "remedy"),
    [
        (fixed(("YellowBox", [-1, -1, 0.75]), kit="random"), "layout.kit", "name the kit's table"),
        (fixed(("RedBox", [-1, -1, 0.75])), "layout.fixed[0].object", "use one of YellowBox"),
        (fixed(("YellowBox", [-1, -1, 0.75]), frame="GreenBox"), "layout.fixed[0].frame", "use base_link"),
        (fixed(*[("YellowBox", [-1, -1, 0.75])] * 2), "layout.fixed[1].object", "one place"),
        (
            fixed(("YellowBox", [-1, -1, 0.75]), ("GreenBox", [-1, -0.95, 0.8])),
            "layout.fixed[1].position",
            "free space",
        ),
        (fixed(("YellowBox", [-1, -1, 0.4])), "layout.fixed[0].position", "move it over one"),
        (fixed(("YellowBox", [-3, -1, 0.75])), "layout.fixed[0].position", "move it over one"),
        (target(object="RedBox"), "targets[0].object", "use one of YellowBox"),
        (target(frame="Shelf"), "targets[0].frame", "use one of YellowBox"),
        (target(frame="YellowBox"), "targets", "give one of them"),
        (in_frame(YellowBox="GreenBox", GreenBox="YellowBox"), "targets", "give one of them"),
        (in_frame(YellowBox="GreenBox", GreenBox="BlueBox", BlueBox="GreenBox"), "targets", "give one of them"),
        ({"targets": target()["targets"] * 2}, "targets[1].object", "one target"),
        (target(position=[0.197, 0, 0.052]), "targets[0].position", "free space"),
        (target(position=[0, 0, 0]), "targets[0].position", "free space"),
        (target(position=[0, 0, 0.02], frame="GreenBox"), "targets[0].position", "free space"),
        (target(position=[0, 0]), "targets[0].position", "three numbers"),
        (target(position=[0, 0, "high"]), "targets[0].position", "a number"),
        (target(position=[0, 0, float("nan")]), "targets[0].position", "a number"),
        (target(position=[0, 0, True]), "targets[0].position", "a number"),
        (target(colour="red"), "targets[0].colour", "use one of object"),
        (target(objekt="RedBox"), "targets[0].objekt", "did you mean object?"),
        ({"targets": [{"object": "YellowBox", "frame": "KittingBox"}]}, "targets[0].position", "add it"),
        ({"targets": []}, "targets", "add at least one"),
        ({"targets": None}, "targets", "expected a list"),
        ({"targets": {"object": "YellowBox"}}, "targets", "expected a list"),
        ({"targets": ["YellowBox"]}, "targets[0]", "expected a mapping"),
        ({"boxes": []}, "boxes", "add at least one"),
        (boxes(size=0.5), "boxes[0].size", "gripper"),
        (boxes(size=0.5) | {"gripper_opening": 1}, "boxes[0].size", "kit"),
        (boxes(size=0), "boxes[0].size", "write 0.005 to 2 m"),
        (boxes(density=-1), "boxes[0].density", "write 10 to 25000 kg/m³"),
        (boxes(size="0,1"), "boxes[0].size", "a number"),
        (boxes(name="YellowBox"), "boxes", "rename"),
        (boxes(name="a box"), "boxes", "letters"),
        ({"tables": []}, "tables", "add at least one"),
        ({"kit": {"size": 2}}, "kit.size", "smaller"),
        ({"kit": {"wall_thickness": 0.3}}, "", ""),
        ({"kit": None}, "kit", "expected a mapping"),
        ({"kit": {"name": "YellowBox"}}, "boxes[0].name", "is also a kit; rename"),
        ({"layout": {"kit": "Shelf"}}, "layout.kit", "use random"),
        ({"layout": {"stack": ["RedBox"]}}, "layout.stack", "use some of"),
        ({"layout": {"stack": ["YellowBox", "YellowBox"]}}, "layout.stack", "once"),
        ({"layout": {"spacing": 2}}, "layout.spacing", "lower spacing"),
        ({"layout": {"margin": 0.4, "spacing": 0}}, "layout.margin", "lower"),
        ({"layout": {"margin": -0.1}}, "layout.margin", "write 0 to 2 m"),
        ({"weights": {"node": -1}}, "weights.node", "write 0 to 1e+06"),
        ({"episode": {"max_ticks": 0}}, "episode.max_ticks", "write 1 to 10000 ticks"),
        ({"episode": {"max_ticks": 1.5}}, "episode.max_ticks", "a whole number"),
        ({"subgoals": ["tidy"]}, "subgoals", "use one of unstacked"),
        ({"subgoals": "unstacked"}, "subgoals", "expected a list"),
        ({"subgoals": [{"name": "tidy"}]}, "subgoals[0].conditions", "add it"),
        ({"subgoals": [{"name": "tidy", "conditions": []}]}, "subgoals[0].conditions", "add a condition"),
        ({"subgoals": ["unstacked", "unstacked"]}, "subgoals[1].name", "is listed twice"),
        ({"subgoal_reward": "asked"}, "subgoal_reward", "expected one of seen, ticked"),
        ({"colour": "red"}, "colour", "use one of"),
        ({7: 8}, "7", "use one of"),
    ],
)
def test_an_invalid_task_is_refused_in_one_sentence(tmp_path, change, key, remedy):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"extends": "stack", "name": "mine"} | change))
    with pytest.raises(UserError) as error:
        load_task(path)
    message = str(error.value)
    assert message.startswith(f"{path}, key {key}")
    assert remedy in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a: [1, 2\nb: 3\n", "line 2 is not valid YAML"),
        (b"\xff\xfe\x00nonsense", "line 1: not UTF-16-LE text; save the file as UTF-8"),
        (b"- 1\n- 2\n", "must be a mapping"),
        (b"", "must be a mapping"),
        (b"extends: shelf\n", "is not another task"),
        (b"extends: mine.yaml\n", "is not another task"),
        (b"extends: sub/../mine.yaml\n", "is not another task"),
        (b"extends: [stack]\n", "is not another task"),
        (b"name: mine\n", "missing; add it"),
    ],
)
def test_files_that_are_no_task(tmp_path, content, words):
    (tmp_path / "sub").mkdir()
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(UserError, match=words) as error:
        load_task(path)
    assert "mine.yaml" in str(error.value)


LETTERS = """extends: stack
name: letters
boxes:
  - {name: No, size: 1e-1, color: [0.9, 0.7, 0.1]}
  - {name: Y, size: 0.1, color: [0.1, 0.6, 0.3]}
targets: [{object: No, position: [0, 0, 5.2e-2], frame: KittingBox}]
episode: {max_ticks: 010, tolerance: 5e-3}
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_numbers_and_names_are_those_of_yaml_1_2_in_any_encoding_with_a_mark(tmp_path, encoding, newline):
    path = tmp_path / "mine.yaml"
    path.write_bytes(LETTERS.replace("\n", newline).encode(encoding))
    task = load_task(path)
    assert task.object_names == ("No", "Y")
    assert task.objects[0].edge == 0.1
    assert (task.episode.max_ticks, task.episode.tolerance, task.targets[0].position[2]) == (10, 0.005, 0.052)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("name: other", "the key 'name' stands in line 2 and in line 3; remove one of them"),
        ("boxes: [{name: A, size: 0.1, size: 0.2, color: [1, 0, 0]}]", "the key 'size' stands in line 3 and in line 3"),
        ("description: " + "[" * 3000, "line 3: brackets are nested more than 30 deep; check them"),
        (
            "description: 1:30:00.5 # a text\ngenes: {grid: 1:30}",
            "key genes.grid: expected a whole number, found '1:30'",
        ),
        ("description: 7", "key description: expected text, found 7; put it in quotes: '7'"),
        ("boxes: [{name: A, size: 0.1}]", "key boxes[0].color: missing; add it, for instance color: [0.9, 0.7, 0.1]"),
    ],
)
def test_what_yaml_allows_and_tasks_do_not(tmp_path, line, message):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: stack\nname: mine\n{line}\n")
    with pytest.raises(UserError) as error:
        load_task(path)
    assert message in str(error.value)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize("name", ["shelf", "stack.yaml", "mine.txt", ".", "", "a/b.yaml"])
def test_tasks_that_are_not_there(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="stack"):
        load_task(name)


json_like = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=100)
@given(st.sampled_from(sorted(load_task("stack").to_dict())), json_like)
def test_any_value_is_a_task_or_a_user_error(key, value):
    data = load_task("stack").to_dict() | {key: value}
    with contextlib.suppress(UserError):
        task = task_from_dict(data, source="mine")
        assert task_from_dict(task.to_dict(), source="again") == task


def test_a_subgoal_has_to_be_ticked_unless_the_task_says_otherwise(tmp_path):
    assert load_task("restack").subgoal_reward == "ticked"
    mine = tmp_path / "mine.yaml"
    for rule in ("seen", "ticked"):
        mine.write_text(yaml.safe_dump({"extends": "restack", "name": "mine", "subgoal_reward": rule}))
        assert load_task(mine).subgoal_reward == rule
    mine.write_text(yaml.safe_dump({"extends": "stack", "name": "mine", "subgoals": ["unstacked"]}))
    assert load_task(mine).subgoal_reward == "ticked"


@pytest.mark.parametrize("kept", ["config.json", "task.yaml"])
def test_tasks_that_were_kept_before_there_was_a_rule_for_subgoals_and_with_another_range_keep_theirs(tmp_path, kept):
    older = load_task("restack").to_dict()
    del older["subgoal_reward"]
    older["layout"]["margin"] = 0.125
    (tmp_path / kept).write_text(json.dumps({"task": older} if kept == "config.json" else older))
    task = task_of_folder(tmp_path)
    assert (task.subgoal_reward, task.layout.margin) == ("seen", 0.125)


def test_an_unfinished_task_may_have_problems_which_are_all_found(tmp_path):
    text = """
extends: stack
name: mine
gripper_opening: 0.05
targets: []
kit: {name: KittingBox, size: 0.8}
"""
    (tmp_path / "mine.yaml").write_text(text)
    task = load_task(tmp_path / "mine.yaml", unfinished=True)
    assert [problem.key for problem in problems(task)] == ["targets", "kits[0].size", "objects[0].size"]
    with pytest.raises(UserError, match="there is nothing to do"):
        load_task(tmp_path / "mine.yaml")
    assert problems(load_task("stack")) == []


def test_an_unfinished_task_still_has_to_make_sense(tmp_path):
    for text, says in (
        ("targets: [{object: Cup, position: [0, 0, 0.05], frame: KittingBox}]", "there is no object 'Cup'"),
        ("layout: {kit: Shelf}", "there is no table 'Shelf'"),
        ("kit: {size: 0.4, wall_thickness: 0.3}", "the walls leave no room"),
    ):
        (tmp_path / "mine.yaml").write_text(f"extends: stack\nname: mine\n{text}\n")
        with pytest.raises(UserError, match=says):
            load_task(tmp_path / "mine.yaml", unfinished=True)
