"""Choosing from a menu, also in a slow browser: a menu that is opened during a change may not show."""

from playwright.sync_api import Locator, Page, TimeoutError, expect

TRIES = 20


def choose_option(page: Page, menu: Locator, name: str, *, stays: bool = True) -> None:
    """Opens a menu, takes the option of this name, and waits until the menu shows it, unless the page will not let it stay.

    A menu shows the option before until the server has heard of the choice; to choose that again does nothing till then.
    """
    option = page.get_by_role("option", name=name, exact=True)
    for _ in range(TRIES):
        menu.click()
        try:
            option.click(timeout=3000)
        except TimeoutError:
            page.keyboard.press("Escape")
            continue
        if stays:
            expect(menu).to_have_value(name)
        return
    raise AssertionError(f"there is no {name} to choose")
