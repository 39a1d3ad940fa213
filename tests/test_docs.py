"""The docs: links lead somewhere, on GitHub and on the site, which builds without a warning."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NAMES = [page.name for page in PAGES]


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Anchors of headings as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", prose(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_link_of_a_page_leads_to_a_file_and_heading(page):
    for target, anchor in re.findall(r"\]\(([^):#\s]*)(?:#([^)]*))?\)", prose(page)):
        path = (page.parent / target).resolve() if target else page
        assert path.is_file(), target
        assert not anchor or anchor in anchors(path), f"{target}#{anchor}"


@pytest.mark.parametrize("page", PAGES[1:], ids=NAMES[1:])
def test_every_page_is_in_the_navigation(page):
    assert f": {page.name}\n" in (ROOT / "mkdocs.yml").read_text("utf-8")


@pytest.mark.parametrize("package", ["bev_driving_env", "agents", "perception", "benchmarks"])
def test_every_public_name_is_in_the_api_reference(package):
    names = importlib.import_module(package).__all__
    shown = (ROOT / "docs/api.md").read_text("utf-8").split("\n")
    functions = [name for name in names if not name.isupper() and name != "__version__"]
    assert functions
    assert not [name for name in functions if f"::: {package}.{name}" not in shown]


class Parts(HTMLParser):
    """What a page of HTML loads, and what it links to."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.linked: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag in ("img", "script", "iframe") and "src" in values:
            self.loaded.append(values["src"])
        if tag == "link" and values.get("rel") != "canonical":
            self.loaded.append(values["href"])
        if tag == "a" and "href" in values:
            self.linked.append(values["href"])

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built strictly."""
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    out = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return out


@pytest.mark.slow
def test_the_site_loads_nothing_from_elsewhere_and_all_it_needs_is_there(site):
    pages = sorted(site.rglob("*.html"))
    assert {"index.html", "api.html", *(f"{page.stem}.html" for page in PAGES[1:])} <= {
        page.name for page in pages
    }
    pictures = 0
    for page in pages:
        parts = Parts()
        parts.feed(page.read_text("utf-8"))
        for target in parts.loaded:
            assert "//" not in target, f"{page.name} loads {target}"
        here = [link for link in parts.linked if not re.match(r"\w+:|#", link)]
        if page.name == "404.html":
            continue  # is served anywhere, so its links start at the root
        for target in parts.loaded + here:
            assert (page.parent / target.partition("#")[0]).exists(), f"{page.name}: {target}"
        pictures += sum("pictures/" in target for target in parts.loaded)
        assert ":func:" not in parts.text
    assert pictures >= 8


@pytest.mark.slow
def test_the_first_page_is_the_readme(site):
    page = (site / "index.html").read_text("utf-8")
    assert "What do bird's-eye-view errors cost" in page
    assert 'href="your_predictor.html"' in page
    assert 'src="pictures/panel.jpg"' in page


@pytest.mark.slow
@pytest.mark.parametrize("script", ["site_pages.py", "docstrings.py"])
def test_the_examples_of_the_hooks_are_true(script):
    pytest.importorskip("mkdocstrings", reason="the extra 'docs' is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "doctest", str(ROOT / "docs" / script)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
