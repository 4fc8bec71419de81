"""Keys for one element, as somebody presses them who sees it."""

from playwright.sync_api import Locator, expect


def press_on(element: Locator, key: str) -> None:
    """Presses a key at an element, once that is there to be used; Playwright's own `press` does not wait for it."""
    expect(element).to_be_visible()
    expect(element).to_be_enabled()
    element.focus()
    expect(element).to_be_focused()
    element.page.keyboard.press(key)
