"""Taking hold of the 3D scene from a test: where things are in it, and on the screen."""

from playwright.sync_api import Page

COMPONENT = "const c = getElement(Number(document.querySelector('[data-testid=scene]').id.slice(1)));"


def position(page: Page, name: str, *, target: bool = False) -> list[float]:
    """World position of a box, or of the translucent copy that shows its target, metres."""
    thing = f"c.ghosts['targets {name}']" if target else f"c.bodies['{name}']"
    return page.evaluate(f"() => {{ {COMPONENT} return {thing}.position.toArray(); }}")


def exists(page: Page, name: str) -> bool:
    """Whether there is a target for a box in the scene."""
    return page.evaluate(f"() => {{ {COMPONENT} return 'targets {name}' in c.ghosts; }}")


def wait_for_copy(page: Page, key: str, *, group: str, gone: bool = False) -> None:
    """Waits until a translucent copy is in the scene, or no longer."""
    page.wait_for_function(f"() => {{ {COMPONENT} return ('{group} {key}' in c.ghosts) !== {str(gone).lower()}; }}")


def at_rest(page: Page) -> None:
    """Waits until the scene is there, and nothing moves in it."""
    for _ in range(2):  # a motion comes in a message of its own, after what the page says of it
        page.wait_for_function(
            f"() => {{ {COMPONENT} return c.scene && c.gripper && !c.motion && !c.frozen && !c.dropped; }}"
        )
        page.wait_for_timeout(50)


def on_screen(page: Page, point: list[float]) -> tuple[float, float]:
    """Where a point of the world [m] is in the window, pixels."""
    x, y = page.evaluate(
        f"""(point) => {{ {COMPONENT}
          c.camera.updateMatrixWorld();
          const seen = c.camera.position.clone().set(...point).project(c.camera);
          const {{ left, top, width, height }} = c.$el.getBoundingClientRect();
          return [left + (seen.x + 1) / 2 * width, top + (1 - seen.y) / 2 * height];
        }}""",
        point,
    )
    return x, y


def click(page: Page, name: str) -> None:
    """Clicks a box in the scene at its middle."""
    at_rest(page)
    page.mouse.click(*on_screen(page, position(page, name)))


def drag(page: Page, name: str, to: list[float] | str, *, target: bool = False, arranging: str = "") -> None:
    """Takes a box, or its target, at its middle and lets it go over a point of the world [m] or another box; `arranging`:
    what can be dragged meanwhile, if it is something else."""
    here, there = _way(page, name, to, arranging or ("targets" if target else "objects"), target=target)
    page.mouse.move(*on_screen(page, here))
    page.mouse.down()
    for part in (0.1, 0.5, 1.0):
        page.mouse.move(*on_screen(page, _between(here, there, part)))
    page.mouse.up()


def finger_drag(page: Page, name: str, to: str, *, near: float = 0.0, taps: int = 0) -> None:
    """Carries a box in a demonstration onto another one with a finger that touches it `near` pixels beside its middle; a
    second finger taps meanwhile."""
    here, there = _way(page, name, to, "hand")
    touch = page.context.new_cdp_session(page)

    def send(kind: str, *points: tuple[float, float]) -> None:
        places = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})

    x, y = on_screen(page, here)
    send("touchStart", (x + near, y))
    for part in (0.1, 0.5, 1.0):
        x, y = on_screen(page, _between(here, there, part))
        send("touchMove", (x, y))
    for _ in range(taps):
        send("touchStart", (x, y), (x + 80, y + 80))
        send("touchEnd", (x, y))
    send("touchEnd")


def _way(
    page: Page, name: str, to: list[float] | str, what: str, *, target: bool = False
) -> tuple[list[float], list[float]]:
    """From where to where something is dragged, once the scene lets a person drag `what`, and is at rest."""
    page.wait_for_function(f"() => {{ {COMPONENT} return c.dragging === '{what}'; }}")
    at_rest(page)
    return position(page, name, target=target), position(page, to) if isinstance(to, str) else to


def _between(here: list[float], there: list[float], part: float) -> list[float]:
    """A point on the way, at the height of its beginning."""
    return [a + part * (b - a) for a, b in zip(here[:2], there[:2], strict=True)] + here[2:]
