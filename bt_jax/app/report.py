"""A report about a run as one HTML page that prints well: what its tree does, in words and as a picture, how it was learnt,
how often it works, and why it fails where it does."""

from __future__ import annotations

import base64
import contextlib
from collections.abc import Sequence
from datetime import datetime
from html import escape
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted, listed
from bt_jax.app.plain_words import Words
from bt_jax.app.state.run_record import RunRecord, failures, read_record, success
from bt_jax.app.widgets.tree_text import tree_list
from bt_jax.behaviors import Behavior
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.walk import prefix
from bt_jax.training.console import PLURALS
from bt_jax.training.plots import learning_curve
from bt_jax.training.result import Failures
from bt_jax.training.run_folder import RunFolder

__all__ = ["report"]

STYLE = Path(__file__).parent / "static" / "report.css"
COMMONEST = 5  # reasons for failures
LISTED = 12  # starts in which the tree fails for a reason
MINUS = "\N{MINUS SIGN}"


def report(folder: RunFolder, *, today: datetime) -> str:
    """Return the report about a run folder. Raise UserError if that cannot be read."""
    record = read_record(folder)
    parts = [
        _head(record, today),
        _figures(record),
        _tree(record),
        _failing(record),
        _faults(record),
        _curve(folder, record),
        _scene(folder),
        _settings(record),
    ]
    head = (
        f'<meta charset="utf-8">\n<title>{escape(record.title)}</title>\n<style>\n{STYLE.read_text("utf-8")}</style>\n'
    )
    foot = f'<footer class="soft">bt_jax {escape(record.config.version)}, run {escape(record.name)}</footer>\n'
    body = "".join(filter(None, parts)) + foot
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}</head>\n<body>\n{body}</body>\n</html>\n'


def _head(record: RunRecord, today: datetime) -> str:
    task, note = record.config.task, record.note.note
    words = Words(task)
    goal = "; ".join(f"{target.object} {words.target(target)}" for target in task.targets)
    said = f'<p class="note">{escape(note)}</p>\n' if note else ""
    return (
        f'<header><div><h1>{escape(record.title)}</h1>\n<p class="soft">Task {escape(task.name)}, report of '
        f"{today:%d %B %Y, %H:%M}</p></div>\n"
        '<button class="print" onclick="window.print()">Print</button></header>\n'
        f"{said}<p>{escape(task.description)}</p>\n<p><b>Goal:</b> {escape(goal)}.</p>\n"
    )


def _figures(record: RunRecord) -> str:
    progress, found = record.progress, []
    if record.result is not None:
        rate = success(record.result)
        low, high = (f"{100 * share:.0f}" for share in (rate.low, rate.high))
        said = f"works in {rate.solved} of {rate.tried} starts that it never saw (95 %: {low} to {high}\N{NO-BREAK SPACE}%)"
        found.append((f"{100 * rate.solved / rate.tried:.0f} %", said))
    if progress is not None and progress.best is not None:
        found.append((f"{progress.best:,.1f}".replace("-", MINUS), "best score; the closer to 0, the better"))
        found.append((f"{progress.generation:,}", f"rounds of learning, {progress.episodes:,} trials"))
    if record.tree is not None:
        found.append((f"{len(prefix(record.tree))}", "parts of the tree"))
    cells = [f'<div class="figure"><b>{value}</b>{escape(name)}</div>' for value, name in found]
    untested = "" if record.result is not None else "<p>It was not tested yet: let the evolution finish.</p>\n"
    return f'<div class="figures">{"".join(cells)}</div>\n{untested}'


def _tree(record: RunRecord) -> str:
    if record.tree is None:
        return "<h2>What it does</h2>\n<p>There is no tree yet.</p>\n"
    words = Words(record.config.task)
    genes = {f"node-{i}" for i, node in enumerate(prefix(record.tree)) if isinstance(node, Behavior) and node.subtree}
    written, drawn = tree_list(record.tree, words, {}, genes), to_svg(record.tree, words=words)
    return (
        f'<h2>What it does, in words</h2>\n<div class="tree">{written}</div>\n'
        f'<h2>What it does, as a picture</h2>\n<div class="picture">{drawn}</div>\n'
    )


def _failing(record: RunRecord) -> str:
    if record.result is None:
        return ""
    rate, reasons = success(record.result), failures(record.result)
    if rate.solved == rate.tried:
        return f"<h2>Where it fails</h2>\n<p>Nowhere: it works in all {rate.tried} starts of the test.</p>\n"
    rows = [
        f'<tr><td class="number">{len(one.layouts)}</td><td>{escape(one.reason)}</td><td>{escape(_where(one))}</td></tr>'
        for one in reasons[:COMMONEST]
    ]
    rest = rate.tried - rate.solved - sum(len(one.layouts) for one in reasons[:COMMONEST])
    if rest > 0:
        rows.append(f'<tr><td class="number">{rest}</td><td>for other reasons</td><td></td></tr>')
    where = "start.draw of the test" if reasons and reasons[0].draws else "starts of the test"
    head = f'<tr><th class="number">times</th><th>why</th><th>{where}</th></tr>'
    return f"<h2>Where it fails</h2>\n<table>{head}\n{''.join(rows)}</table>\n"


def _where(group: Failures) -> str:
    """Say in which starts a tree fails for a reason; where things go wrong by chance, as start.draw."""
    numbers = [f"{layout}.{draw}" for layout, draw in zip(group.layouts, group.draws, strict=False)]
    return listed(numbers or list(map(str, group.layouts)), LISTED)


def _faults(record: RunRecord) -> str:
    """Say how often the tree works where each fault has happened, if things go wrong in the task."""
    met = (record.result or {}).get("faults")
    if not isinstance(met, dict):
        return ""
    rows = [
        f'<tr><td>{escape(PLURALS[name])}</td><td class="number">{escape(str(one["solved"]))} of '
        f"{escape(str(one['episodes']))}</td></tr>"
        for name, one in met.items()
        if name in PLURALS and isinstance(one, dict) and {"solved", "episodes"} <= set(one)
    ]
    if not rows:
        return ""
    head = '<tr><th>what</th><th class="number">works in</th></tr>'
    return f"<h2>Where things go wrong</h2>\n<table>{head}{''.join(rows)}</table>\n"


def _curve(folder: RunFolder, record: RunRecord) -> str:
    with contextlib.suppress(UserError):
        history = folder.history()
        if history:
            svg = learning_curve(history, title="", phases=record.phases, kind="svg").decode()
            picture = svg[svg.index("<svg") :]
            return f'<h2>How it was learnt</h2>\n<div class="picture curve">{picture}</div>\n'
    return "<h2>How it was learnt</h2>\n<p>There is no learning curve yet.</p>\n"


def _scene(folder: RunFolder) -> str:
    try:
        png = base64.b64encode((folder.path / "final_scene.png").read_bytes()).decode()
    except OSError:
        return ""
    alt = "The scene after the tree has run once"
    return f'<h2>{alt}</h2>\n<div class="picture"><img alt="{alt}" src="data:image/png;base64,{png}"></div>\n'


def _settings(record: RunRecord) -> str:
    gp, simulation = record.config.gp, record.config.settings
    rows: Sequence[tuple[str, str]] = (
        ("method", gp.method),
        ("trees in each generation", str(gp.population)),
        ("random seed", str(gp.seed)),
        ("layouts to learn in", str(simulation.layouts_of(record.config.task))),
        ("layouts to test in", str(simulation.test_layouts)),
        ("phases", counted(record.config.phase + 1, "phase")),
        ("simulation", f"{simulation.level}, {simulation.backend}"),
    )
    lines = "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<h2>For experts</h2>\n<table>{lines}</table>\n"
