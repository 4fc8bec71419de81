"""A person at the gripper, with nothing but the keyboard."""

import re

from playwright.sync_api import expect

KEYS = {"x": ("ArrowRight", "ArrowLeft"), "y": ("ArrowUp", "ArrowDown"), "z": ("PageUp", "PageDown")}


def position(see, frame, axis):
    """What the table says, millimetres."""
    return float(see(f"demonstrate-pose-{frame}-{axis}").inner_text().replace("\N{MINUS SIGN}", "-"))


def press(page, see, key, times, *, frame, axis, sign, step):
    """Presses a key, and waits until the page says that each has had its effect."""
    before = position(see, frame, axis)
    for _ in range(times):
        page.keyboard.press(key)
    expect(see(f"demonstrate-pose-{frame}-{axis}")).to_have_text(said(before + sign * times * step))


def said(value):
    """What the table says of a value, which is rounded there."""
    texts = (f"{round(near)}".replace("-", "\N{MINUS SIGN}") for near in (value - 1, value, value + 1))
    return re.compile(f"^({'|'.join(map(re.escape, texts))})$")


def set_step(page, see, step):
    """The step, with the keys + and - only."""
    field = see("demonstrate-step")
    for _ in range(12):
        now = float(field.input_value())
        if now == step:
            return
        page.keyboard.press("+" if now < step else "-")
        expect(field).not_to_have_value(f"{now:g}")
    raise AssertionError(f"the step {step} is none of those that + and - come to")


def carry(page, see, goal, frame):
    """Carries the held object to within 5 mm of a position [mm] in a frame."""
    for step in (200, 10):
        set_step(page, see, step)
        for axis, value in zip("xyz", goal, strict=True):
            away = value - position(see, frame, axis)
            key = KEYS[axis][0 if away > 0 else 1]
            sign, times = (1 if away > 0 else -1), round(abs(away) / step)
            press(page, see, key, times, frame=frame, axis=axis, sign=sign, step=step)
