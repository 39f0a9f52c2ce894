"""Measures whether everything on a page can be read: nothing is cut off, hidden or covered."""

from __future__ import annotations

from pathlib import Path

from tests.browser.chromium import Tab

SIZES = {"projector": (1920, 1080), "laptop": (1366, 768)}
SCHEMES = ("light", "dark")

_FAULTS = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")


def faults(tab: Tab, scrolled: str = "") -> list[str]:
    """Return what cannot be read on the page: one sentence for each fault.

    `scrolled` is a selector of the parts that a reader scrolls on purpose, such as an editor.
    """
    tab.drawn()
    return list(tab.run(_FAULTS, scrolled))


def all_faults(tab: Tab, *parts: str, scrolled: str = "") -> list[str]:
    """Return the faults at both sizes; `parts` say what is shown.

    The faults are of places and sizes, which no colour scheme changes.
    """
    found = []
    for size, pixels in SIZES.items():
        tab.size(*pixels)
        where = ", ".join((*parts, size))
        found += [f"{where}: {each}" for each in faults(tab, scrolled)]
    return found
