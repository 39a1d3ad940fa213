"""The page in headless Chromium, at the widths of a phone and of a desk."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.cli import main

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
SIZES = {"phone": (390, 844), "desk": (1280, 900)}


@pytest.fixture(scope="module")
def page(run_folder: Path) -> Path:
    assert main(["report", str(run_folder), "--workers", "1"]) == 0
    return run_folder / "report.html"


@pytest.fixture(scope="module", params=SIZES)
def browser(request: Any, page: Path, tmp_path_factory: Any) -> Iterator[Any]:
    """Chromium of a size, in which the page has been opened."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="pip install '.[browser]'")
    from selenium.webdriver.chrome.service import Service

    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    profile = tmp_path_factory.mktemp("profile")
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    width, height = SIZES[request.param]
    found = webdriver.Chrome(options=options, service=Service(driver))
    try:
        found.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        found.get("about:blank")
        found.get_log("performance")  # the browser's own first page
        found.get(page.as_uri())
        yield found
    finally:
        found.quit()


@pytest.fixture
def opened(browser: Any) -> Any:
    """The browser with the focus at the start of the page and all details shown."""
    browser.refresh()
    browser.execute_script("document.querySelectorAll('details').forEach(e => e.open = true)")
    return browser


def press(browser: Any, key: str) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(browser).send_keys(key).perform()


def test_there_is_no_console_error_and_no_request_but_for_the_page(browser, page):
    assert browser.get_log("browser") == []
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = {
        message["params"]["request"]["url"]
        for message in messages
        if message["method"] == "Network.requestWillBeSent"
    }
    assert {url for url in asked if not url.startswith("data:")} == {page.as_uri()}


def test_nothing_is_wider_than_the_screen_but_what_scrolls_by_itself(opened):
    wide = opened.execute_script(
        "return [...document.querySelectorAll('body *')]"
        ".filter(e => !e.closest('.scroll') && !e.closest('pre') && !e.matches('.skip'))"
        ".filter(e => e.getBoundingClientRect().right > innerWidth + 1)"
        ".map(e => e.outerHTML.slice(0, 80))"
    )
    assert wide == []
    width = "return document.documentElement.scrollWidth <= window.innerWidth"
    assert opened.execute_script(width)


def test_every_section_has_a_heading_and_every_link_leads_to_one(opened):
    headings = opened.execute_script(
        "return [...document.querySelectorAll('section')].map(e => e.querySelector('h2').innerText)"
    )
    assert headings[0] == "How far each got"
    assert len(headings) >= 4
    links = opened.execute_script(
        "return [...document.querySelectorAll('a')].map(e => e.getAttribute('href'))"
    )
    assert len(links) == len(headings) + 1
    for link in links:
        assert opened.execute_script("return !!document.querySelector(arguments[0])", link), link


def test_the_first_tab_reaches_the_skip_link_which_leads_past_the_navigation(opened):
    from selenium.webdriver.common.keys import Keys

    press(opened, Keys.TAB)
    focused = opened.switch_to.active_element
    assert focused.get_attribute("class") == "skip"
    assert focused.rect["x"] >= 0
    press(opened, Keys.ENTER)
    assert opened.switch_to.active_element.get_attribute("id") == "main"


def test_whatever_scrolls_sideways_can_be_reached_by_keyboard(opened):
    unreachable = opened.execute_script(
        "return [...document.querySelectorAll('.scroll, pre')]"
        ".filter(e => e.scrollWidth > e.clientWidth && e.tabIndex < 0).length"
    )
    assert unreachable == 0


def test_pictures_are_decoded_and_described(opened):
    pictures = opened.execute_async_script(
        "const done = arguments[0]; const all = [...document.images];"
        "Promise.all(all.map(e => e.decode())).then("
        "() => done(all.map(e => [e.naturalWidth, e.alt])), e => done(String(e)))"
    )
    assert isinstance(pictures, list), pictures
    assert len(pictures) >= 21
    assert all(width > 0 and words for width, words in pictures)


def test_a_film_stands_still_until_it_is_played_and_the_slider_moves_it_by_keyboard(opened):
    from selenium.webdriver.common.keys import Keys

    where = "return document.querySelector('.film').style.objectPosition"
    assert opened.execute_script(where) == ""
    opened.execute_script("document.querySelector('.film-controls input').focus()")
    press(opened, Keys.HOME)
    assert opened.execute_script(where) == "0px 0%"
    press(opened, Keys.END)
    assert opened.execute_script(where) == "0px 100%"
    opened.execute_script("document.querySelector('.play').focus()")
    press(opened, Keys.SPACE)
    label = "return document.querySelector('.play').textContent"
    assert opened.execute_script(label) == "Pause"
    press(opened, Keys.SPACE)
    assert opened.execute_script(label) == "Play"
