"""The hand of a person in the twin: what the camera sees of it, and what it hides. It touches nothing."""

from __future__ import annotations

import dataclasses

__all__ = ["HandModel"]

Color = tuple[float, float, float]
Triple = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class HandModel:
    """A right hand that holds a box from above, of capsules. Lengths are shares of the box's size, but for the arm's, in
    metres; its frame is at the middle of the box, the arm leads off along x."""

    skin: Color = (0.86, 0.66, 0.55)
    sleeve: Color = (0.25, 0.3, 0.45)
    fingers: int = 4
    finger: float = 0.2  # radius
    palm: Triple = (1.0, 0.95, 0.36)  # half axes
    heel: Triple = (0.35, 0.8, 0.75)  # half axes of the heel of the hand and the ball of the thumb, before the box
    arm: float = 0.034  # radius, m
    rise: float = 0.5  # of the arm, m/m
    length: float = 0.5  # of the arm, m

    def mjcf(self, name: str, size: float) -> str:
        """Return the <body> with a free joint that shows the hand around a box of this size [m]."""
        skin, sleeve = (f'rgba="{" ".join(map(str, color))} 1"' for color in (self.skin, self.sleeve))
        geoms = [
            f'<geom type="ellipsoid" pos="{_text(size, 0.85, 0.0, 1.3)}" size="{_text(size, *self.palm)}" '
            f'euler="0 -0.35 0" {skin}/>',
            f'<geom type="ellipsoid" pos="{_text(size, 1.0, 0.0, 0.45)}" size="{_text(size, *self.heel)}" {skin}/>',
            _capsule(size, (1.0, -0.6, 0.8), (0.8, 0.5, 0.0), 1.2 * self.finger, skin),
        ]
        for i in range(self.fingers):
            y = 0.75 * (2 * i / max(self.fingers - 1, 1) - 1)
            geoms.append(_capsule(size, (0.3, y, 1.35), (-0.7, 0.8 * y, 1.0), self.finger, skin))
            geoms.append(_capsule(size, (-0.7, 0.8 * y, 1.0), (-0.75, 0.7 * y, 0.0), 0.9 * self.finger, skin))
        wrist = (1.7 * size, 0.0, 1.55 * size)
        middle = (wrist[0] + 0.25 * self.length, 0.0, wrist[2] + 0.25 * self.rise * self.length)
        elbow = (wrist[0] + self.length, 0.0, wrist[2] + self.rise * self.length)
        geoms.append(_capsule(1.0, wrist, middle, 0.85 * self.arm, skin))
        geoms.append(_capsule(1.0, middle, elbow, self.arm, sleeve))
        shapes = "\n".join(geoms).replace("<geom ", '<geom contype="0" conaffinity="0" mass="0" group="2" ')
        inertia = '<inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>'
        return f'<body name="{name}" pos="0 0 -9"><freejoint/>{inertia}\n{shapes}\n</body>'


def _capsule(size: float, start: Triple, end: Triple, radius: float, color: str) -> str:
    return (
        f'<geom type="capsule" fromto="{_text(size, *start)} {_text(size, *end)}" size="{size * radius:.5g}" {color}/>'
    )


def _text(size: float, *numbers: float) -> str:
    return " ".join(f"{size * number:.5g}" for number in numbers)
