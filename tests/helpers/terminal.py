"""A console at which a person types something."""

import io

from rich.console import Console


class Terminal(Console):
    """Keeps what is printed in `said`, and answers every question with `typed`."""

    def __init__(self, typed: str) -> None:
        super().__init__(file=io.StringIO(), width=160)
        self.typed = typed

    def input(self, *_, **__) -> str:
        return self.typed

    @property
    def said(self) -> str:
        return self.file.getvalue()
