"""Choosing from a menu, also in a slow browser: a menu that is opened during a change may not show."""

from playwright.sync_api import Locator, Page, TimeoutError

TRIES = 20


def choose_option(page: Page, menu: Locator, name: str) -> None:
    """Opens a menu and takes the option of this name."""
    option = page.get_by_role("option", name=name, exact=True)
    for _ in range(TRIES):
        menu.click()
        try:
            option.click(timeout=3000)
            return
        except TimeoutError:
            page.keyboard.press("Escape")
    raise AssertionError(f"there is no {name} to choose")
