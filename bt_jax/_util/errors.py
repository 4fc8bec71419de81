"""The one exception that a user is meant to read."""

import re

__all__ = ["UserError"]

_ENDLESS = re.compile(r"(\S{100})\S{300,}(\S{20})")  # as damaged files hold for names


class UserError(Exception):
    """Something the user can fix; the message is one sentence, on one line, that ends with the remedy.

    The command lines print it without a traceback and exit with code 2. A command or an option is named in the remedy only,
    after a semicolon: the page, which has neither, leaves that part out (`app.phrases`). Where the page has a remedy of its
    own, the error carries a `code`, by which the page finds its phrase, and the parameters of that phrase.
    """

    def __init__(self, sentence: str, *, code: str = "", **parameters: object) -> None:
        super().__init__(_ENDLESS.sub(r"\1...\2", " ".join(sentence.splitlines())))
        self.code, self.parameters = code, parameters
