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
    tab.run_async(
        "await document.fonts.ready;"
        "await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
    return list(tab.run(_FAULTS, scrolled))


def all_faults(tab: Tab, *parts: str, scrolled: str = "") -> list[str]:
    """Return the faults at both sizes and in both colour schemes; `parts` say what is shown."""
    found = []
    for size, pixels in SIZES.items():
        for scheme in SCHEMES:
            tab.size(*pixels)
            tab.prefer(color_scheme=scheme)
            where = ", ".join((*parts, size, scheme))
            found += [f"{where}: {each}" for each in faults(tab, scrolled)]
    return found
