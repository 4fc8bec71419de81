"""The history of a run as CSV: one row for each generation and run."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence

from bt_jax._util.errors import UserError
from bt_jax.gp.evolution import Generation

__all__ = ["history_csv", "read_history"]


def history_csv(history: Sequence[Generation]) -> str:
    """Return the rows as text; fitness and diversity have 4 digits after the point."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(field.name for field in dataclasses.fields(Generation))
    for row in history:
        writer.writerow(f"{x:.4f}" if isinstance(x, float) else x for x in dataclasses.astuple(row))
    return out.getvalue()


def read_history(text: str) -> list[Generation]:
    """Return the rows that `history_csv` wrote. Raise UserError, naming the line, if it did not."""
    kinds = {field.name: {"int": int, "float": float}[str(field.type)] for field in dataclasses.fields(Generation)}
    rows, found = csv.DictReader(io.StringIO(text)), []
    try:
        for row in rows:
            found.append(Generation(**{name: kinds[name](value) for name, value in row.items()}))
    except (ValueError, KeyError, TypeError, csv.Error) as error:
        raise UserError(f"line {rows.line_num} is not a generation; restore the file") from error
    return found
