"""The documentation site opens from a folder, finds words, and loads only its own files."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.browser.chromium import PHONE, Tabs

ROOT = Path(__file__).parents[2]
PAGES = ("index.html", "docs/explanation/silence.html", "docs/reference/api/taskrpc.html")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Build the site once."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(ROOT / "docs" / "site" / "make.py"), str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.parametrize("page", PAGES)
def test_a_page_loads_only_files_of_the_site(tabs: Tabs, site: Path, page: str):
    tab = tabs.open((site / page).as_uri())
    assert "taskrpc" in tab.text(".md-header__title")
    script = """
        return [...document.querySelectorAll("script[src], link[rel=stylesheet], img, source")]
            .map(e => e.src || e.href || e.srcset)
    """
    loaded = [each for each in tab.run(script) if each.startswith(("http:", "https:", "//"))]
    assert not loaded


def test_the_search_works_without_a_server(tabs: Tabs, site: Path):
    tab = tabs.open((site / "docs" / "index.html").as_uri())
    tab.click(".md-search__input")
    tab.keys("deadlock")
    titles = tab.wait(lambda: tab.texts(".md-search-result__item h1"), "results of the search")
    assert "Where ROS 2 hangs in silence" in titles


# Shows the contents of another page, as Material's instant navigation does. To load each page with
# its scripts takes six times as long.
_SHOW = """
    const [address, text] = args;
    if (!document.querySelector("base")) document.head.append(document.createElement("base"));
    document.querySelector("base").href = address;
    const css = "[data-md-component=container]";
    const page = new DOMParser().parseFromString(text, "text/html");
    document.querySelector(css).replaceWith(page.querySelector(css));
    document$.next(document);
    await Promise.all([...document.images].map(each => each.decode()));
"""
# How far a page is too wide, then the number of columns of each table that scrolls in its box.
_TOO_WIDE = """
    const tables = [...document.querySelectorAll(".md-typeset table:not([class])")];
    const isTooWide = e => e.scrollWidth > e.closest(".md-typeset__scrollwrap").clientWidth + 1;
    const page = document.documentElement; // on a phone, innerWidth grows with the contents
    const columns = table => table.rows[0].cells.length;
    const faults = tables.filter(isTooWide).map(columns);
    return [page.scrollWidth - page.clientWidth, faults];
"""


def test_pages_and_their_tables_fit_a_phone(tabs: Tabs, site: Path):
    tab = tabs.open((site / PAGES[1]).as_uri(), size=PHONE)
    pages = [page for page in sorted(site.rglob("*.html")) if "<table>" in page.read_text("utf-8")]
    assert len(pages) > 50
    faults = []
    for page in pages:
        tab.run_async(_SHOW, page.as_uri(), page.read_text("utf-8"))
        assert tab.all(".md-typeset__scrollwrap"), "the theme puts each table into a box"
        too_wide, columns = tab.run(_TOO_WIDE)
        if too_wide > 0 or any(each < 4 for each in columns):
            faults.append(f"{page.relative_to(site)}: {too_wide} px too wide; {columns}")
    assert faults == []


def test_the_cheat_sheet_is_one_page_of_paper(tabs: Tabs, site: Path):
    tab = tabs.open((site / "docs" / "teach" / "cheat-sheet.html").as_uri())
    printed = tab.command("Page.printToPDF", preferCSSPageSize=True)["data"]
    assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(printed))) == 1
