"""axe-core, which finds what keeps people from using a page; from npm, never kept in the repository."""

import os
from pathlib import Path

from playwright.sync_api import Page

ROOT = Path(__file__).parents[3]
SCRIPT = Path("node_modules", "axe-core", "axe.min.js")
GRAVE = ("serious", "critical")


def axe_script() -> Path | None:
    """axe-core: in the folder that $BT_JAX_NODE names, else in the checkout or above it; None if it is not installed.

    A variable that names no such folder is an error, so that a check is not skipped unnoticed.
    """
    given = os.environ.get("BT_JAX_NODE")
    if given is not None:
        found = Path(given) / SCRIPT
        assert found.is_file(), f"$BT_JAX_NODE is set, but there is no {found}"
        return found
    return next((folder / SCRIPT for folder in (ROOT, *ROOT.parents) if (folder / SCRIPT).is_file()), None)


def grave_faults(page: Page, script: Path) -> list[str]:
    """What is serious or critical on the page as it is now: the rule, the elements, and what is wrong with the first."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(script.read_text(encoding="utf-8"))
    found = page.evaluate(
        """async () => (await axe.run(document, {rules: {"target-size": {enabled: true}}, resultTypes: ["violations"]}))
             .violations.map(({id, impact, nodes}) => ({id, impact, what: nodes.map((node) => node.html.slice(0, 200)),
                                                      why: nodes[0].failureSummary}))"""
    )
    return [f"{one['id']}: {one['what']}: {one['why']}" for one in found if one["impact"] in GRAVE]
