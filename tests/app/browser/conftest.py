"""One server, one headless browser and one window for each module of tests; a picture of the page if a test fails."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from bt_jax.training.progress import is_alive, read_progress
from tests.helpers.browser.steps import TOUR_SEEN

ROOT = Path(__file__).parents[3]
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-compositing",  # software draws the scene; what is around it costs less without a GPU
)
PATIENCE = 180_000  # milliseconds; on an idle machine nothing waits for long
expect.set_options(timeout=PATIENCE)


class Server:
    """A page that is being served: its address, the folder that it works in, and what it prints."""

    def __init__(self, port: int, folder: Path, log: Path, *options: str) -> None:
        self.port, self.folder, self.log, self.options = port, folder, log, options
        self.url = f"http://127.0.0.1:{port}"
        self.process: subprocess.Popen | None = None

    def start(self) -> None:
        """Serves, and waits until the page answers."""
        words = [sys.executable, "-m", "bt_jax.app", "--folder", self.folder, "--port", self.port, "--no-show"]
        words += self.options
        # NiceGUI serves differently if it detects a test.
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
        environment["PYTHONPATH"] = str(ROOT)
        with self.log.open("a") as out:
            self.process = subprocess.Popen([*map(str, words)], cwd=ROOT, env=environment, stdout=out, stderr=out)
        while self.process.poll() is None:
            try:
                urllib.request.urlopen(self.url, timeout=5).close()
                return
            except urllib.error.HTTPError:
                return  # it asks for a token
            except (urllib.error.URLError, OSError):
                time.sleep(0.1)
        raise RuntimeError(f"the server has ended: {self.log.read_text()}")

    def kill(self) -> None:
        """Ends it without a warning."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> None:
        """Ends it as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def restart(self, page: Page) -> None:
        """Ends it and serves again; the window has left the page, which would reload itself while another is opened."""
        page.goto("about:blank")
        self.stop()
        self.start()


@pytest.fixture(scope="module")
def options():
    """Further options of the server; a module may have its own."""
    return ()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that the page works in; a module may have one with something in it."""
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def server(folder, options):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    served = Server(port, folder, folder.parent / f"{folder.name}.log", *options)
    try:
        served.start()
        yield served
    finally:
        served.stop()
        for run in (folder / "runs").glob("*"):
            if is_alive(run):  # evolutions outlive the page
                os.kill(read_progress(run).pid, signal.SIGKILL)


@pytest.fixture(scope="module")
def browser():
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


class Windows:
    """The windows that are open on the page: the first is shared by the tests of a module, the others are of one test."""

    def __init__(self, browser: Browser, url: str) -> None:
        self.browser, self.url = browser, url
        self.shared: Page | None = None
        self.others: list[Page] = []
        self.errors: list[str] = []

    def open(self, *, first_visit: bool = False) -> Page:
        """Opens a window of 1280 x 720 on the page, waits until it is there, and leaves the start screen; on a first visit,
        the tour begins there."""
        context = self.browser.new_context(viewport={"width": 1280, "height": 720}, accept_downloads=True)
        if not first_visit:
            context.add_init_script(TOUR_SEEN)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(self.url)
        page.get_by_test_id("tab-task").wait_for()
        if not first_visit and page.get_by_test_id("start-screen").is_visible():
            page.get_by_test_id("start-back").click()
            page.get_by_test_id("start-screen").wait_for(state="hidden")
        return page

    def end(self, *, pictures: Path | None) -> None:
        """Ends a test: closes its windows and, if it has failed, the shared one, too, after a picture of each."""
        shared = [] if self.shared is None else [self.shared]
        for number, page in enumerate(shared + self.others if pictures else self.others):
            if page.is_closed():
                continue
            if pictures:
                page.screenshot(path=pictures / f"window-{number}.png")
            page.context.close()
        self.others = []
        if pictures or (self.shared is not None and self.shared.is_closed()):
            self.shared = None


@pytest.fixture(scope="module")
def windows(server, browser):
    return Windows(browser, server.url)


@pytest.fixture
def window(windows, server, request, tmp_path):
    """Opens another window for this test; errors of scripts in any window fail it."""

    def open_window(*, first_visit: bool = False) -> Page:
        windows.others.append(windows.open(first_visit=first_visit))
        return windows.others[-1]

    windows.errors.clear()
    yield open_window
    failed = getattr(request.node, "failed", False)
    windows.end(pictures=tmp_path if failed else None)
    if failed:
        print(f"pictures of the page: {tmp_path}; what the server said: {server.log}")
    assert windows.errors == []


@pytest.fixture
def page(window, windows):
    """The window that the tests of a module share."""
    windows.shared = windows.shared or windows.open()
    return windows.shared


@pytest.fixture
def see(page):
    """The element with a test id."""

    def find(testid: str) -> Locator:
        return page.get_by_test_id(testid)

    return find


@pytest.fixture
def shoot(page):
    """Keeps a picture of the window for the documents, if $BT_JAX_PICTURES names a folder for it."""

    def keep(name: str) -> None:
        folder = os.environ.get("BT_JAX_PICTURES")
        if folder:
            page.wait_for_timeout(2500)  # what moves comes to rest, notifications go
            page.screenshot(path=Path(folder) / f"page_{name}.png")

    return keep


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.failed:
        item.failed = True
    return report
