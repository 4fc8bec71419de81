"""The words of a laboratory, which nobody on a shop floor should have to know."""

import re

from playwright.sync_api import Page

BANNED = re.compile(r"(?<![\w-])(fitness|seed|episode|layout|frame)(e?s)?(?![\w-])", re.IGNORECASE)

# All that a person may read or hear of an element, except in parts that are called "Advanced".
TEXTS = """() => {
  const found = [document.title];
  for (const one of document.body.querySelectorAll("*")) {
    if (one.closest("[data-testid$=-advanced], script, style")) continue;
    for (const name of ["title", "aria-label", "placeholder", "alt", "label"]) found.push(one.getAttribute(name));
    for (const node of one.childNodes) if (node.nodeType === Node.TEXT_NODE) found.push(node.data);
  }
  return found.filter((text) => text && text.trim());
}"""


def banned_texts(page: Page) -> list[str]:
    """The texts of a window, hidden or not, that hold a word of a laboratory."""
    return sorted({text for text in page.evaluate(TEXTS) if BANNED.search(text)})
