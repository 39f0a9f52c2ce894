"""The pages of the bundle for students: start, installation for each system, and labs.

The texts are in `pages/`; the words in capitals between two `@` are replaced.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from typing import Final

import msgspec

from taskrpc.course.labs.catalogue import LABS

START: Final = "START-HERE.html"
"""The page that students open first."""
LABS_PAGE: Final = "labs.html"

_SYSTEM_NAMES = {"windows": "Windows", "macos": "macOS", "linux": "Linux"}
_MEGABYTES, _WITH_JUPYTER = 120, 400  # of an environment, generously
_WORD = re.compile(r"@([A-Z]+)@")


class Contents(msgspec.Struct, frozen=True, kw_only=True):
    """What the pages say about a bundle."""

    version: str
    """taskrpc's own version."""
    systems: Sequence[str]
    """Keys of `wheels.SYSTEMS`."""
    pythons: Sequence[str]
    """Such as `3.12`."""
    requirements: Sequence[str]
    """What students install."""
    pip: str = "pip"
    """The name of pip's own wheel."""
    docs: str = ""
    """The first page of the documentation, "" if it is not in the bundle."""
    sheets: Mapping[int, str] = {}
    """The sheet of each lab, as far as there are sheets."""
    notebooks: str = ""
    """The folder of the notebooks, "" if there are none."""
    browser_lab: str = ""
    """The folder of the labs in a browser tab, "" without them."""

    @property
    def jupyter(self) -> bool:
        """Whether students install Jupyter too."""
        return len(self.requirements) > 1


def pages(contents: Contents) -> dict[str, str]:
    """Return the HTML of each page by its file name."""
    made = {START: _page("taskrpc: start here", "start.html", contents)}
    made[LABS_PAGE] = _page("The labs of taskrpc", "labs.html", contents)
    for system in contents.systems:
        title = f"Install taskrpc on {_SYSTEM_NAMES[system]}"
        made[f"install-{system}.html"] = _without_missing(
            _page(title, f"{system}.html", contents), contents.systems
        )
    return made


def _page(title: str, name: str, contents: Contents) -> str:
    folder = resources.files("taskrpc.course.classroom") / "pages"
    words = _words(contents)
    body = _WORD.sub(lambda found: words[found[1]], (folder / name).read_text(encoding="utf-8"))
    words |= {"TITLE": title, "BODY": body.strip()}
    frame = (folder / "page.html").read_text(encoding="utf-8")
    return _WORD.sub(lambda found: words[found[1]], frame)


def _words(contents: Contents) -> dict[str, str]:
    pythons = contents.pythons
    return {
        "VERSION": escape(contents.version),
        "PYTHON": "3.12" if "3.12" in pythons else pythons[0],
        "PYTHONS": alternatives(pythons),
        "REQUIREMENTS": escape(
            " ".join(f'"{each}"' if "[" in each else each for each in contents.requirements), False
        ),
        "PIP": escape(contents.pip),
        "SPACE": str(_WITH_JUPYTER if contents.jupyter else _MEGABYTES),
        "SYSTEMS": "".join(
            f'<a href="install-{system}.html">{_SYSTEM_NAMES[system]}</a>'
            for system in contents.systems
        ),
        "CONTENTS": "\n".join(f"<li>{line}</li>" for line in _contents(contents)),
        "LABS": "\n".join(_labs(contents)),
        "MORE": "\n".join(f"<p>{line}</p>" for line in _more(contents)),
    }


def alternatives(words: Sequence[str]) -> str:
    """Return `3.11`, `3.11 or 3.12`, `3.11, 3.12 or 3.13`."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


def _contents(contents: Contents) -> Iterator[str]:
    yield f'<a href="{LABS_PAGE}">The labs</a>: their sheets, and how to start and check them.'
    if contents.docs:
        yield f'<a href="{contents.docs}">The documentation</a>.'
    yield from _more(contents)


def _more(contents: Contents) -> Iterator[str]:
    if contents.notebooks:
        how = (
            f"<code>jupyter notebook {contents.notebooks}</code>, in the window of the installation"
            if contents.jupyter
            else "they need Jupyter, which is not in this folder:"
            " <code>pip install notebook</code>, with the internet"
        )
        yield f'<a href="{contents.notebooks}/">Notebooks</a>: {how}.'
    if contents.browser_lab:
        yield (
            "The first labs in a browser tab:"
            f" <code>taskrpc view --lab --pyodide {contents.browser_lab}</code>, in the window of"
            " the installation. Without Python: open the address that your lecturer shows"
            " (<code>taskrpc classroom lab</code>)."
        )


def _labs(contents: Contents) -> Iterator[str]:
    for lab in LABS:
        title = f"{lab.number}. {escape(lab.title)}"
        if sheet := contents.sheets.get(lab.number):
            title = f'<a href="{escape(sheet)}">{title}</a>'
        yield f"<tr><td>{title}</td><td>{lab.minutes}</td><td>{escape(lab.goal)}</td></tr>"


def _without_missing(page: str, systems: Sequence[str]) -> str:
    """Return a page without the links to the pages of systems that the bundle leaves out."""
    for system in _SYSTEM_NAMES.keys() - systems:
        page = re.sub(rf' · <a href="install-{system}\.html">\w+</a>', "", page)
    return page
