"""The slides of the lecture: Marp renders them, and nothing is cut off."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.browser.chromium import Tabs
from tests.javascript.packages import node_for, node_modules

ROOT = Path(__file__).parents[2]
DECK = ROOT / "docs" / "teach" / "slides.md"
MARP = "@marp-team/marp-core"

# The title of each slide whose content is larger than the slide.
CUT_OFF = """
    const [slack] = arguments;
    return [...document.querySelectorAll("section")].filter(slide => {
        const {bottom, right} = slide.getBoundingClientRect();
        return [...slide.querySelectorAll("p, li, pre, table, img, h2")].some(each => {
            const box = each.getBoundingClientRect();
            const wide = each.scrollWidth > each.clientWidth + 1;
            return box.bottom > bottom - slack || box.right > right || wide;
        });
    }).map(slide => slide.querySelector("h1, h2").innerText);
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    """Render the deck once."""
    page = tmp_path_factory.mktemp("slides") / "slides.html"
    program = Path(__file__).with_name("render_slides.mjs")
    command = [node_for(MARP), str(program), str(node_modules()), str(DECK), str(page)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return page


def test_each_heading_is_a_slide_and_no_slide_is_cut_off(tabs: Tabs, page: Path):
    tab = tabs.open(page.as_uri())
    text = DECK.read_text(encoding="utf-8")
    assert len(tab.all("section")) == text.count("\n## ") + 1
    assert tab.run("return [...document.images].filter(e => !e.naturalWidth).map(e => e.src)") == []
    assert tab.run(CUT_OFF, 32) == []
