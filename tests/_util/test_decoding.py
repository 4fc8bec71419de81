import dataclasses
import enum
from collections.abc import Mapping
from typing import Literal

import pytest

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError


class Colour(enum.StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclasses.dataclass(frozen=True)
class Shelf:
    name: str
    height: float
    boards: int = 3


@dataclasses.dataclass(frozen=True)
class Room:
    shelves: tuple[Shelf, ...]
    corner: tuple[float, float] = (0.0, 0.0)
    doors: tuple[str, ...] = ()
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    light: Literal["on", "off"] = "on"
    colour: Colour = Colour.RED
    owner: str | None = None
    heated: bool = False

    def __post_init__(self) -> None:
        if len(self.doors) > 2:
            raise ValueError("there are more than two doors; close one")


SHELF = {"name": "oak", "height": 2}


def test_values_have_the_types_of_their_fields():
    room = decode(
        {
            "shelves": [SHELF],
            "corner": [1, 2.5],
            "weights": {"oak": 3},
            "colour": "blue",
            "owner": "Ann",
            "heated": True,
        },
        Room,
        "room.yaml",
    )
    assert room == Room((Shelf("oak", 2.0),), (1.0, 2.5), (), {"oak": 3.0}, "on", Colour.BLUE, "Ann", True)
    assert type(room.shelves[0].height) is float


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shelves": None}, "key shelves: expected a list, found null; write one '- ' entry for each"),
        ({"shelves": [5]}, "key shelves[0]: expected a mapping, found 5; write keys such as name, height, boards"),
        ({"shelves": [{"name": "oak"}]}, "key shelves[0].height: missing; add it, for instance height: 1.8"),
        ({"shelves": [SHELF | {"heightt": 1}]}, "key shelves[0].heightt: not known here; did you mean height?"),
        ({"shelves": [SHELF | {"x": 1}]}, "key shelves[0].x: not known here; use one of name, height, boards"),
        ({"shelves": [{"name": "oak", "heighd": 2}]}, "key shelves[0].heighd: not known here; did you mean height?"),
        ({"shelves": [SHELF | {"name": 7}]}, "key shelves[0].name: expected text, found 7; put it in quotes: '7'"),
        ({"shelves": [SHELF | {"height": "2 m"}]}, "expected a number, found '2 m'; write one such as 0.05"),
        ({"shelves": [SHELF | {"height": float("nan")}]}, "expected a number, found nan"),
        ({"shelves": [SHELF | {"height": 10**400}]}, "expected a number, found 1000"),
        ({"shelves": [SHELF | {"height": False}]}, "expected a number, found false"),
        ({"shelves": [SHELF | {"boards": 2.5}]}, "expected a whole number, found 2.5; write one such as 10"),
        ({"corner": [1]}, "key corner: expected two numbers, found [1]; write a list such as [0.1, 0]"),
        ({"corner": "12"}, "key corner: expected two numbers, found '12'"),
        ({"corner": [1, "x"]}, "key corner[1]: expected a number, found 'x'"),
        ({"doors": "front"}, "key doors: expected a list of names, found 'front'"),
        ({"doors": [True]}, "key doors[0]: expected text, found true; put it in quotes: 'true'"),
        ({"weights": {"oak": "heavy"}}, "key weights.oak: expected a number, found 'heavy'"),
        ({"light": "dim"}, "key light: expected one of on, off, found 'dim'"),
        ({"colour": 3}, "key colour: expected one of red, blue, found 3"),
        ({"owner": []}, "key owner: expected text or null, found []"),
        ({"doors": ["a", "b", "c"]}, "there are more than two doors; close one"),
    ],
)
def test_what_does_not_fit_is_named_with_its_key(change, message):
    with pytest.raises(UserError) as error:
        decode({"shelves": [SHELF]} | change, Room, "room.yaml", examples={"height": "1.8"})
    assert str(error.value).startswith("room.yaml")
    assert message in str(error.value)


def test_a_key_may_lie_inside_a_file():
    with pytest.raises(UserError, match=r"^run.json, key rooms\[2\].shelves: missing; add it$"):
        decode({}, Room, "run.json", key="rooms[2]")


@pytest.mark.parametrize("data", ["x" * 10_000, [[["x"] * 1000] * 1000] * 1000, {i: i for i in range(1000)}])
def test_a_long_value_is_abridged(data):
    with pytest.raises(UserError) as error:
        decode({"shelves": [SHELF], "light": data}, Room, "room.yaml")
    assert len(str(error.value)) < 200
