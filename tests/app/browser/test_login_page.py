"""A page that others can reach lets only those in who know the token."""

import re

import pytest
from playwright.sync_api import expect

from tests.helpers.browser.steps import TOUR_SEEN, go

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def options():
    return ("--allow-host", "lab-pc")


@pytest.fixture
def token(server):
    return re.search(r"token ([0-9a-f]{16});", server.log.read_text())[1]


@pytest.fixture
def visit(browser, server):
    """Opens a browser that has never logged in on a path of the page."""
    contexts = []

    def open_page(path):
        contexts.append(browser.new_context())
        contexts[-1].add_init_script(TOUR_SEEN)
        page = contexts[-1].new_page()
        page.goto(server.url + path)
        return page

    yield open_page
    for context in contexts:
        context.close()


def test_the_token_is_typed_into_a_form(visit, token):
    page = visit("/?step=run")
    page.get_by_label("Token").fill("0123456789abcdef")
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_contain_text("This token is wrong")
    page.get_by_label("Token").fill(token)
    page.keyboard.press("Enter")
    page.get_by_test_id("tab-evolve").click()  # the websocket is let in, too
    expect(page.get_by_test_id("panel-evolve")).to_be_visible()
    assert "token" not in page.url


def test_the_address_that_is_printed_lets_in(visit, token):
    page = visit(f"/login?token={token}")
    expect(page.get_by_test_id("panel-task")).to_be_visible()
    assert page.evaluate("document.cookie") == ""
    page.reload()
    expect(page.get_by_test_id("panel-task")).to_be_visible()


def test_the_form_takes_the_place_of_a_page_whose_login_has_ended(visit, token):
    page = visit(f"/login?token={token}")
    go(page.get_by_test_id, "evolve")  # it is connected
    page.context.clear_cookies()
    page.evaluate("window.socket.disconnect()")
    expect(page.get_by_label("Token")).to_be_focused()
