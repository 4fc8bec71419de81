import time

import pytest

from bt_jax._util.errors import UserError
from bt_jax._util.yaml_files import parse_yaml, read_yaml, to_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5e-3", 0.005),
        ("-1.5E+2", -150.0),
        ("010", 10),
        ("0o10", 8),
        ("1:30", "1:30"),
        ("No", "No"),
        ("on", "on"),
        ("y", "y"),
        ("true", True),
        ("~", None),
        ("2020-01-01", "2020-01-01"),
        ("=", "="),
        ("1_000", "1_000"),
        ("1__2", "1__2"),
        ("0.0_5", "0.0_5"),
        ("-_", "-_"),
        ("-0o_", "-0o_"),
        ("0b11", "0b11"),
        ("0x1f", 31),
        ("+12", 12),
        ("-.5", -0.5),
        ("1.", 1.0),
        ("-.inf", -float("inf")),
        ("!!str 12", "12"),
        ("", None),
        ("[1, two]", [1, "two"]),
        ("{a: 1:30, b: x:y}", {"a": "1:30", "b": "x:y"}),
        ("{a: &x [1], b: *x}", {"a": [1], "b": [1]}),
    ],
)
def test_values_are_those_of_yaml_1_2(text, value):
    assert parse_yaml(text, "mine.yaml") == value
    assert type(parse_yaml(text, "mine.yaml")) is type(value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", "mine.yaml: the key 'a' stands in line 1 and in line 3; remove one of them"),
        ("x:\n- {a: 1, b: 2,\n  'a': 3}", "the key 'a' stands in line 2 and in line 3"),
        ("a: [1\nb: 2", "mine.yaml, line 2 is not valid YAML (expected ',' or ']'"),
        ("a:\n\tb: 1", "mine.yaml, line 2 is not valid YAML (a tab cannot indent; use spaces)"),
        ("a: *x", "line 1 is not valid YAML (found undefined alias 'x')"),
        ("a: &x\n  b: *x", "mine.yaml, line 2: the alias x stands inside itself"),
        ("a: !!python/object:os.system x", "mine.yaml, line 1: the tag tag:yaml.org,2002:python/object:os.system"),
        ("a: !mine x", "mine.yaml, line 1: the tag !mine is not supported; remove it"),
        ("a: 1\n---\nb: 1", "line 2 is not valid YAML (expected a single document in the stream but found another"),
        ("{b: 1, {{box}}: 2}", "mine.yaml, line 1: a list or a mapping cannot be a key"),
        ("- a\n" * 300_000, "mine.yaml has more than 1,000,000 characters; give a file that was written for bt_jax"),
        ("- [1, 2]\n" * 6_000 + "- [", "mine.yaml, line 6002 is not valid YAML"),
        ("a: \x07", "mine.yaml is not valid YAML (unacceptable character #x0007"),
        ("b: 1\na: " + "1" * 5000, "mine.yaml, line 2 is not valid YAML (a number of more than 1,000 digits)"),
        *((f"b: 1\na: !!{tag}", f"mine.yaml, line 2: the tag tag:yaml.org,2002:{tag.split()[0]} is not supported; remove it")
          for tag in ("bool maybe", "int ''", "int abc", "float x", "null x", "bool [1]")),
        ('a: "\\U00110000"', "mine.yaml is not valid YAML ("),
        ('a: "\\UFFFFFFFF"', "mine.yaml is not valid YAML ("),
        ("[" * 500 + "]" * 500, "mine.yaml, line 1: brackets are nested more than 30 deep; check them"),
        ("a:\n" + "\n".join("  " * i + "- - a:" for i in range(1, 40)), "nested more than 30 deep"),
        ("\n".join(f"k{i}: &k{i} [{', '.join([f'*k{i - 1}'] * 9)}]" for i in range(9)).replace("*k-1", "x"),
         "line 6: aliases repeat more than 100,000 values; write them out"),
    ],
)  # fmt: skip
def test_what_is_refused_is_refused_at_once_in_one_short_sentence(text, message):
    began = time.process_time()
    with pytest.raises(UserError) as error:
        parse_yaml(text, "mine.yaml")
    assert time.process_time() - began < 2
    assert message in str(error.value)
    assert str(error.value).startswith("mine.yaml")
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 200


def test_a_file_is_named_in_its_errors(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert read_yaml(path) == {"a": 1, "b": 2}
    path.write_text("a: 1\na: 2\n")
    with pytest.raises(UserError, match=f"^{path}: the key 'a' stands in line 1 and in line 2"):
        read_yaml(path)


def test_what_is_written_means_the_same_in_yaml_1_1_and_1_2():
    data = {"off": "No", "time": "1:30", "octal": "010", "small": 1e-5, "large": 2e22, "list": [1, 2.5, None, True],
            "é": {"in": [{"deep": 1}]}, "y": "y", "day": "2020-01-01", "lines": "one\ntwo", "yes": "0o10"}  # fmt: skip
    text = to_yaml(data)
    assert parse_yaml(text, "again") == data
    assert list(parse_yaml(text, "again")) == list(data)  # in this order
    for line in ("'off': 'No'", "time: '1:30'", "octal: '010'", "small: 1.0e-05", "list: [1, 2.5, null, true]", "'y': 'y'",
                 "day: '2020-01-01'"):  # fmt: skip
        assert line in text.splitlines()
