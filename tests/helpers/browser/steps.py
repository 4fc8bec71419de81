"""Going from step to step, and waiting for what they show."""

from collections.abc import Callable

from playwright.sync_api import Locator, Page, expect

# A script of a context that was here before, so that the tour does not begin.
TOUR_SEEN = "if (location.protocol !== 'about:') localStorage.setItem('bt_jax-tour', 'seen')"


def without_plan(see: Callable[[str], Locator]) -> None:
    """Sets step 2 to evolve, without a plan, which would often end it at once."""
    if not see("evolve-population").is_visible():
        see("evolve-advanced").get_by_text("Advanced").click()
    if see("evolve-plan").is_checked():
        see("evolve-plan").click()
    expect(see("evolve-plan")).not_to_be_checked()


def go(see: Callable[[str], Locator], step: str) -> None:
    """Goes to a step, and waits until it is shown: before that, a click on the tab of the step before does nothing."""
    see(f"tab-{step}").click()
    expect(see(f"panel-{step}")).to_be_visible()


def until(page: Page, condition: Callable[[], bool]) -> None:
    """Waits for what no element says by itself."""
    for _ in range(1200):
        if condition():
            return
        page.wait_for_timeout(100)
    raise AssertionError("it does not happen")
