"""Build step of the site: run the blocks that begin with ```python exec, and show what they print below them.

The blocks of a page share one namespace. With `html` after `exec` the output is HTML, such as a drawn tree. A block that
fails ends the build.
"""

import contextlib
import io
import re
import traceback
from typing import Any

from mkdocs.exceptions import PluginError

from bt_jax._util.startup import configure_jax

BLOCK = re.compile(r"^```python exec(?P<html> html)?\n(?P<code>.*?)^```$", re.M | re.S)


def on_startup(**_: Any) -> None:
    """Keep compiled functions between builds."""
    configure_jax("cpu")


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Return the page with the output of its blocks. Raise PluginError if one fails."""
    namespace: dict[str, Any] = {}

    def run(match: re.Match[str]) -> str:
        out = io.StringIO()
        try:
            with contextlib.redirect_stdout(out):
                exec(compile(match["code"], page.file.src_uri, "exec"), namespace)
        except Exception:
            raise PluginError(f"{page.file.src_uri}: a block fails\n{traceback.format_exc()}") from None
        code = f"```python\n{match['code']}```\n\n"
        if match["html"]:
            return f"{code}<div>{out.getvalue().strip()}</div>"
        return f'{code}```text title="Output"\n{out.getvalue().rstrip()}\n```'

    return BLOCK.sub(run, markdown)
