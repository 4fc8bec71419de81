"""What goes wrong in an episode, and how often: one specification for the simulation and the twin.

A probability is that of one attempt (`slip`, `drop`, `jam`), of one tick (`hide`, `move`, `take`), or of one episode
(`heavy`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.yaml_files import read_yaml

__all__ = ["FAULTS", "PRESETS", "Faults", "faults_of", "load_faults", "only"]


@dataclasses.dataclass(frozen=True)
class Faults:
    """What goes wrong, and how often; nothing unless it is said.

    Each `pick` slips, so that the gripper closes on nothing, each `place` drops the object on the way, and each command
    jams, so that the gripper does not open or close, with a probability. What is placed misses its place by Gaussian errors
    of standard deviation `place_spread` [m] along x and y, and `turn_spread` [degrees]. After each tick, with a probability,
    an object goes out of sight for `hide_ticks`, or a person moves one elsewhere or takes one away for `take_ticks`. In
    each episode an object, or all of a part, may be heavier or more slippery than thought: `heavy_slip` of its picks slip,
    and as many are dropped. `objects`: those to which this happens, parts for all their instances; all if none is named.
    """

    slip: float = 0.0
    drop: float = 0.0
    jam: float = 0.0
    place_spread: float = 0.0
    turn_spread: float = 0.0
    hide: float = 0.0
    hide_ticks: int = 3
    move: float = 0.0
    take: float = 0.0
    take_ticks: int = 3
    heavy: float = 0.0
    heavy_slip: float = 0.5
    objects: tuple[str, ...] = ()


PRESETS: Mapping[str, Faults] = MappingProxyType(
    {
        "mild": Faults(
            slip=0.05,
            drop=0.01,
            jam=0.01,
            place_spread=0.003,
            turn_spread=1.0,
            hide=0.02,
            move=0.005,
            take=0.005,
            heavy=0.01,
        ),
        "harsh": Faults(
            slip=0.15,
            drop=0.02,
            jam=0.03,
            place_spread=0.006,
            turn_spread=2.0,
            hide=0.05,
            move=0.01,
            take=0.01,
            heavy=0.02,
        ),
    }
)
FAULTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {  # fault -> the keys that switch it on
        "slip": ("slip",),
        "drop": ("drop",),
        "jam": ("jam",),
        "misplace": ("place_spread", "turn_spread"),
        "hide": ("hide",),
        "move": ("move",),
        "take": ("take",),
        "heavy": ("heavy",),
    }
)


def only(faults: Faults, *names: str) -> Faults:
    """Return the faults with these, keys of FAULTS, alone switched on."""
    off: dict[str, Any] = {key: 0.0 for name, keys in FAULTS.items() if name not in names for key in keys}
    return dataclasses.replace(faults, **off)


def load_faults(name_or_path: str | Path) -> Faults:
    """Return a preset by name, a key of PRESETS, or the faults in a YAML file. Raise UserError, naming file and key, for
    what is neither; whether they fit a task is for `with_faults` to say."""
    text = str(name_or_path)
    if text in PRESETS:
        return PRESETS[text]
    path = Path(text)
    if path.suffix not in (".yaml", ".yml"):
        raise UserError(f"there are no faults '{text}'; choose one of {', '.join(PRESETS)}, or give a .yaml file")
    if not path.is_file():
        raise UserError(f"there is no file {path}; check the path, or choose one of {', '.join(PRESETS)}")
    return decode(read_yaml(path), Faults, str(path))


def faults_of(written: Faults | str | None, source: str) -> Faults | None:
    """Return the faults that the file of a task says, which may name a preset. Raise UserError, naming `source`, for another
    name."""
    if not isinstance(written, str):
        return written
    if written not in PRESETS:
        remedy = f"use one of {', '.join(PRESETS)}, or a mapping such as {{slip: 0.1}}"
        raise UserError(f"{source}, key faults: '{written}' is unknown; {remedy}")
    return PRESETS[written]
