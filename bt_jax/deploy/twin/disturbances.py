"""What may go wrong in the twin's cell, one thing a run: a person's hand, an unknown object, light, lens, camera, delays.

A disturbance happens at a moment that the seed chooses, or where a hand is in the right place: the same for the same seed.
`DISTURBANCES` names them all.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.twin.disturber import Disturbance, Disturber
from bt_jax.deploy.twin.triggers import Moment

__all__ = ["DISTURBANCES", "disturbance"]


def _pictures(**values: float) -> Disturbance:
    """Return pictures that get worse at some time."""

    def act(disturber: Disturber, moment: Moment) -> str | None:
        if not disturber.trigger.due(moment):
            return None
        disturber.camera.change(**values)
        return "the pictures"

    return Disturbance(act)


DISTURBANCES: Mapping[str, Disturbance] = {
    "swap": Disturbance(Disturber.swap),
    "turn-early": Disturbance(Disturber.turn_early),
    "turn-late": Disturbance(Disturber.turn_late),
    "steal": Disturbance(Disturber.steal),
    "lost-in-carry": Disturbance(Disturber.lose),
    "unknown-beside": Disturbance(Disturber.add_beside, stranger=""),
    "unknown-on": Disturbance(Disturber.add_on, stranger=""),
    "kit-moved": Disturbance(Disturber.move_kit),
    "kit-covered": Disturbance(Disturber.cover_kit),
    "dark": _pictures(exposure=-10.0),
    "bright": _pictures(exposure=3.0),
    "flicker": _pictures(flicker=0.3),
    "noise": _pictures(noise=12.0),
    "blur-0.7": Disturbance(realism={"blur": 0.7}),
    "blur-1.0": Disturbance(realism={"blur": 1.0}),
    "camera-5mm": Disturbance(realism={"camera_moved": (0.0, 0.0, 0.005)}),
    "camera-1deg": Disturbance(realism={"camera_turned": (float(np.radians(1.0)), 0.0, 0.0)}),
    "duplicate-ids": Disturbance(Disturber.add_twin, stranger="GreenBox"),
    "on-its-side": Disturbance(Disturber.lay_on_side),
    "egm-lag": Disturbance(realism={"egm_lag": 0.15}),
    "gripper-latency": Disturbance(realism={"gripper_delay": 0.6}),
}


def disturbance(what: str) -> Disturbance:
    """Return what is called so. Raise UserError if nothing is."""
    if what not in DISTURBANCES:
        raise UserError(f"there is no disturbance '{what}'; choose one of {', '.join(DISTURBANCES)}")
    return DISTURBANCES[what]
