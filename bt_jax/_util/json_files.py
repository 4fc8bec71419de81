"""Reading the JSON files that the program writes, which disks, editors and copying may have damaged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_text

__all__ = ["read_json"]


def read_json(path: Path) -> Any:
    """Return what a JSON file holds. Raise UserError, naming the file, if it cannot be read or is not JSON."""
    text = read_text(path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise UserError(f"{path}, line {error.lineno}: not valid JSON ({error.msg}); restore the file") from error
    except (ValueError, RecursionError) as error:  # thousands of digits or brackets
        raise UserError(f"{path} is damaged: numbers or brackets without end; restore the file") from error
