"""The one exception that a user is meant to read."""

import re

__all__ = ["UserError"]

_ENDLESS = re.compile(r"(\S{100})\S{300,}(\S{20})")  # as damaged files hold for names
LONGEST = 1000  # characters of a sentence; of what is longer, the middle is left out
END = 300  # of them at its end, where the remedy stands


class UserError(Exception):
    """Something the user can fix; the message is one sentence, on one line, that ends with the remedy.

    The command lines print it without a traceback and exit with code 2. A command or an option is named in the remedy only,
    after a semicolon: the page, which has neither, leaves that part out (`app.phrases`). Where the page has a remedy of its
    own, the error carries a `code`, by which the page finds its phrase, and the parameters of that phrase.
    """

    def __init__(self, sentence: str, *, code: str = "", **parameters: object) -> None:
        super().__init__(_shown(sentence))
        self.code, self.parameters = code, parameters


def _shown(text: str) -> str:
    """Return a text as one line of bounded length without control characters, whatever it quotes."""
    text = _ENDLESS.sub(r"\1...\2", " ".join(text.splitlines()))
    if not text.isprintable():
        text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - END - 5]} ... {text[-END:]}"
