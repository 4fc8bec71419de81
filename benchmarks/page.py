"""Is the page quick enough? From the start of the server to the first picture of the scene; from a click to the first
generation, to a pause, to a stop; pictures a second, with up to 16 objects; stalls."""

# A headless Chromium draws the scene in software, on the same cores that evolve. Where other programs load the machine, the
# processor time tells more than the clock.

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import tyro
from playwright.sync_api import Browser, Page, expect, sync_playwright

from benchmarks._processor import processor_seconds
from benchmarks._report import report
from bt_jax._util.yaml_files import to_yaml
from bt_jax.tasks import load_task
from bt_jax.training.progress import is_alive, read_progress

FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--ignore-gpu-blocklist",
)
PATIENCE = 300_000  # milliseconds
SCRIPT = "pick BlueBox; to (0, 0, 0.055) KittingBox; release"
READY = 20  # seconds after which nothing is left to be done in advance
WATCH = """() => {
  const now = { last: performance.now(), stall: 0, trip: 0, trips: 0 };
  window.watched = now;
  setInterval(() => { const t = performance.now(); now.stall = Math.max(now.stall, t - now.last - 10); now.last = t; }, 10);
  (async () => {
    for (;;) {
      const sent = performance.now();
      await fetch("/?ping", { method: "HEAD", cache: "no-store" }).catch(() => null);
      now.trip = Math.max(now.trip, performance.now() - sent); now.trips += 1;
      await new Promise((done) => setTimeout(done, 50));
    }
  })();
}"""
SCENE = "getElement(Number(document.querySelector('[data-testid=scene]').id.slice(1)))"
RENDERED = f"() => {SCENE}.rendered"
SHOWN = f"() => document.querySelector('[data-testid=scene]') && {SCENE}?.gripper && {SCENE}.rendered > 0"
MANY = 16  # objects


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Times of the page on this machine."""

    repeat: int = 3
    """servers to start, cold and warm"""
    seconds: float = 10.0
    """for which the scene is turned, and the page watched"""
    starts: bool = True
    """also time first generations, which takes some minutes"""
    chromium: str = "chromium"
    """the browser"""


def main(arguments: Arguments) -> None:
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as scratch:
        path = shutil.which(arguments.chromium)
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        first = _first_pictures(browser, Path(scratch), arguments.repeat)
        report("page_first_picture", "from the start of the server to the first picture of the scene, seconds", first)
        orders, frames, stalls = _at_work(browser, Path(scratch), arguments)
        report("page_orders", "from the click to what it says on the page, seconds", orders)
        report("page_frames", "pictures of the scene a second while it is turned", frames)
        report("page_stalls", "longest stalls, milliseconds", stalls)
        if arguments.starts:
            starts = _starts(browser, Path(scratch), arguments.repeat)
            report("page_start", "from the click to the first generation on the page, seconds", starts)


def _first_pictures(browser: Browser, scratch: Path, repeat: int) -> list[dict[str, Any]]:
    """On the clock, and the processor time of the server alone, and of the browser."""
    clock, server, drawing = [], [], []
    for number in range(repeat):
        began, before = time.perf_counter(), processor_seconds(_browser(), below=True)
        with (
            _served(scratch / f"work-first-{number}", scratch / "cache-kept") as (url, pid),
            _opened(browser, url) as page,
        ):
            page.wait_for_function(SHOWN)
            clock.append(time.perf_counter() - began)
            server.append(processor_seconds(pid))
            drawing.append(processor_seconds(_browser(), below=True) - before)
    columns = {"on the clock": clock, "server's processor": server, "browser's processor": drawing}
    return [{"what": what, "median": median(times), "most": max(times)} for what, times in columns.items()]


def _starts(browser: Browser, scratch: Path, repeat: int) -> list[dict[str, Any]]:
    """With nothing compiled and with everything; clicked as soon as the page is there, and when all is ready."""
    rows = []
    for kept in ("nothing compiled yet", "compiled before"):
        for moment, wait in (("as soon as the page is open", False), (f"{READY} s later", True)):
            times = []
            for number in range(repeat):
                cache = scratch / (f"cache-{wait}-{number}" if kept.startswith("nothing") else "cache-kept")
                with (
                    _served(scratch / f"work-{kept[0]}-{wait}-{number}", cache) as (url, _),
                    _opened(browser, url) as page,
                ):
                    _see(page, "tab-evolve").click()
                    expect(_see(page, "evolve-start")).to_be_enabled()
                    if wait:
                        page.wait_for_timeout(1000 * READY)
                    times.append(_first_generation(page))
            rows.append({"code": kept, "clicked": moment, "median": median(times), "most": max(times)})
    return rows


def _first_generation(page: Page) -> float:
    began = time.perf_counter()
    _see(page, "evolve-start").click()
    page.wait_for_function(
        "() => /^[0-9]+ of/.test(document.querySelector('[data-testid=evolve-generation]').innerText)", timeout=PATIENCE
    )
    return time.perf_counter() - began


def _at_work(browser: Browser, scratch: Path, arguments: Arguments) -> tuple[list, list, list]:
    """Pause, resume, stop; the scene turned by hand; and stalls, while the page and an evolution are at work."""
    work, cache = scratch / "work", scratch / "cache-kept"
    orders, frames, stalls = [], [], []
    command = [sys.executable, "-m", "bt_jax.demonstrate", str(work / "demonstrations" / "demonstrations"), SCRIPT]
    subprocess.run([*command, "--task", "stack", "--noise", "0.003"], check=True, stdout=subprocess.DEVNULL)
    many = load_task("kit12")
    more = [dataclasses.replace(many.objects[i], name=f"More{i}") for i in range(MANY - len(many.objects))]
    (work / "tasks").mkdir(parents=True)
    many = dataclasses.replace(many, name="many", objects=(*many.objects, *more))
    (work / "tasks" / "many.yaml").write_text(to_yaml(many.to_dict()), encoding="utf-8")
    with _served(work, cache) as (url, _), _opened(browser, url) as page:
        frames.append(_turned(page, f"nothing, with {MANY} objects", arguments.seconds, task="many"))
        frames.append(_turned(page, "nothing", arguments.seconds, task="stack"))
        page.evaluate(WATCH)
        stalls.append(_watched(page, "nothing", lambda: page.wait_for_timeout(1000 * arguments.seconds)))
        _see(page, "tab-evolve").click()
        _first_generation(page)
        expect(_see(page, "evolve-stage")).to_have_text("finished", timeout=PATIENCE)

        _see(page, "evolve-generations").fill("100000")
        _first_generation(page)
        stalls.append(_watched(page, "evolving", lambda: page.wait_for_timeout(1000 * arguments.seconds)))
        frames.append(_turned(page, "evolving", arguments.seconds))
        for _ in range(arguments.repeat):
            orders.append(("pause", _order(page, "evolve-pause", "paused")))
            orders.append(("resume", _order(page, "evolve-pause", "evolving")))
        stalls.append(_watched(page, "evolving and learning from demonstrations", lambda: _learn(page, url)))
        stalls.append(_watched(page, "evolving and running a tree", lambda: _run(page)))
        _see(page, "tab-evolve").click()
        page.wait_for_timeout(1000)
        orders.append(("stop", _order(page, "evolve-stop", "stopping", "testing", "stopped")))
    table = {name: [seconds for order, seconds in orders if order == name] for name in ("pause", "resume", "stop")}
    rows = [{"order": name, "median": median(times), "most": max(times)} for name, times in table.items()]
    return rows, frames, stalls


def _order(page: Page, testid: str, *stages: str) -> float:
    """Seconds from a click until the page shows one of these stages."""
    began = time.perf_counter()
    _see(page, testid).click()
    page.wait_for_function(
        "(stages) => stages.includes(document.querySelector('[data-testid=evolve-stage]').innerText.toLowerCase())",
        arg=list(stages),
        timeout=PATIENCE,
    )
    return time.perf_counter() - began


def _learn(page: Page, url: str) -> None:
    page.goto(f"{url}/?step=understand")
    page.evaluate(WATCH)
    expect(_see(page, "understand-action-2")).to_be_visible(timeout=PATIENCE)
    choices = page.locator("[data-testid^=understand-frame-2-]")
    for name in [choice.get_attribute("data-testid").rpartition("-")[2] for choice in choices.all()]:
        _see(page, f"understand-frame-2-{name}").click()
        expect(_see(page, "message")).to_contain_text(f"relative to {name}", timeout=PATIENCE)


def _run(page: Page) -> None:
    _see(page, "tab-run").click()
    _see(page, "run-restart").click()
    _see(page, "run-play").click()
    expect(_see(page, "run-verdict")).to_contain_text("The tree", timeout=PATIENCE)


def _watched(page: Page, what: str, act) -> dict[str, Any]:
    """The longest stall of the browser's thread, and the longest answer of the server, meanwhile."""
    page.evaluate("() => Object.assign(window.watched, { stall: 0, trip: 0, last: performance.now() })")
    act()
    seen = page.evaluate("() => window.watched")
    return {"at work": what, "browser": seen["stall"], "server's answer": seen["trip"]}


def _turned(page: Page, what: str, seconds: float, task: str | None = None) -> dict[str, Any]:
    """Pictures a second while somebody turns the scene with the mouse, and processor time for each in all processes of the
    browser; of another task, if it is named."""
    if task is not None:
        _see(page, "task-choice").click()
        page.get_by_role("option", name=task, exact=True).click()
        expect(_see(page, "task-choice")).to_have_value(task)
        page.wait_for_timeout(1000)
    box = _see(page, "scene").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + 40
    page.mouse.move(x, y)
    page.mouse.down()
    began, first, step = time.perf_counter(), page.evaluate(RENDERED), 0
    spent = processor_seconds(_browser(), below=True)
    while time.perf_counter() - began < seconds:
        step += 1
        page.mouse.move(x + (step % 200 if step % 400 < 200 else 200 - step % 200), y)
    frames, elapsed = page.evaluate(RENDERED) - first, time.perf_counter() - began
    spent = processor_seconds(_browser(), below=True) - spent
    page.mouse.up()
    return {"at work": what, "pictures a second": frames / elapsed, "processor, ms a picture": 1000 * spent / frames}


def _browser() -> int:
    """The process that drives the browser, of which its other processes are children."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text(encoding="utf-8").split()
    return next(
        int(pid) for pid in children if "playwright" in Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")
    )


@contextlib.contextmanager
def _served(folder: Path, cache: Path) -> Iterator[tuple[str, int]]:
    """A server with its own folder and its own store of compiled code; evolutions that outlive it are killed."""
    folder.mkdir(parents=True, exist_ok=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-m", "bt_jax.app", "--folder", str(folder), "--port", str(port), "--no-show"],
        env=os.environ | {"BT_JAX_CACHE": str(cache)},
        stdout=subprocess.DEVNULL,
    )
    url = f"http://127.0.0.1:{port}"
    try:
        while process.poll() is None:
            with contextlib.suppress(OSError):
                urllib.request.urlopen(url, timeout=5).close()
                break
            time.sleep(0.05)
        yield url, process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
        for run in (folder / "runs").glob("*"):
            if is_alive(run):
                os.kill(read_progress(run).pid, signal.SIGKILL)


@contextlib.contextmanager
def _opened(browser: Browser, url: str) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    context.add_init_script("localStorage.setItem('bt_jax-tour', 'seen')")
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(url)
    _see(page, "tab-task").wait_for()
    yield page
    context.close()


def _see(page: Page, testid: str):
    return page.get_by_test_id(testid)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
