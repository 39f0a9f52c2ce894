"""The pages of the bundle: readable offline, with the commands and the errors of each system."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest

from taskrpc.course.classroom.bundle_pages import Contents, alternatives, pages
from taskrpc.course.classroom.wheels import PYTHONS, SYSTEMS, Wanted

VOID = {"meta", "link", "br", "img"}


def contents(systems=tuple(SYSTEMS), pythons=PYTHONS, jupyter=False, **more):
    requirements = Wanted(jupyter=jupyter).requirements
    return Contents(
        version="1.2", systems=systems, pythons=pythons, requirements=requirements, **more
    )


MADE = pages(contents(docs="docs/index.html", pip="pip-26.0-py3-none-any.whl"))


class Page(HTMLParser):
    """Notes the open elements, the loaded files, the links and the ids."""

    def __init__(self, text):
        super().__init__()
        self.open, self.loaded, self.links, self.ids = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.loaded += [given["src"]] if "src" in given else []
        self.links += [given["href"]] if tag == "a" else []
        self.ids += [given["id"]] if "id" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, (tag, self.getpos())


@pytest.mark.parametrize("name", MADE)
def test_page_is_whole_and_loads_nothing(name):
    page = Page(MADE[name])
    assert page.open == []
    assert page.loaded == []
    assert "url(" not in MADE[name]
    assert not re.search(r"@[A-Z]+@", MADE[name])
    assert len(page.ids) == len({*page.ids})
    for link in page.links:
        known = {*MADE, *(f"#{each}" for each in page.ids), "docs/index.html"}
        assert link in known or link.startswith("https://www.python.org/downloads/"), link


@pytest.mark.parametrize(
    ("system", "commands"),
    [
        (
            "windows",
            [
                'py -3.12 -m venv "%USERPROFILE%\\taskrpc"',
                "-m pip install --no-index --find-links wheels"
                ' "taskrpc[completion,simulate,tls,web]"</code>',
                "Scripts\\activate",
            ],
        ),
        ("macos", ["python3.12 -m venv ~/taskrpc", "source ~/taskrpc/bin/activate"]),
        ("linux", ["python3 -m venv ~/taskrpc", "wheels/pip-26.0-py3-none-any.whl/pip install"]),
    ],
)
def test_installation_page_has_the_commands(system, commands):
    for command in [*commands, "<code>taskrpc demo</code>", "taskrpc join taskrpc-join1.…"]:
        assert command in MADE[f"install-{system}.html"]


@pytest.mark.parametrize(
    ("system", "errors"),
    [
        (
            "windows",
            [
                "Python was not found; run without arguments to install from the Microsoft Store",
                "'py' is not recognized as an internal or external command",
                "No runtime installed that matches 3.12",
                "running scripts is disabled on this system",
                "(from versions: none)",
                "32-bit Python",
                "Unable to create process using",
                "Windows Long Path support",
                "[WinError 5] Access is denied",
                "No module named 'taskrpc'",
                "old pip",
            ],
        ),
        (
            "macos",
            [
                "xcode-select: note: No developer tools were found",
                "error: externally-managed-environment",
                "zsh: command not found: python",
                "incompatible architecture (have 'x86_64', need 'arm64')",
                "Operation not permitted",
                "spaces",
            ],
        ),
        (
            "linux",
            [
                "ensurepip is not\navailable",
                "error: externally-managed-environment",
                "Command 'python' not found",
                "Permission denied",
                "spaces",
            ],
        ),
    ],
)
def test_installation_page_answers_the_errors_of_its_system(system, errors):
    for error in errors:
        assert error in MADE[f"install-{system}.html"]


def test_pages_name_only_the_pythons_and_systems_of_the_bundle():
    made = pages(contents(["linux"], ["3.13"]))
    assert {*made} == {"START-HERE.html", "labs.html", "install-linux.html"}
    assert "You need Python 3.13, 64 bit." in made["START-HERE.html"]
    for text in made.values():
        assert "install-windows.html" not in text
        assert "3.12" not in text


def test_start_page_links_only_what_is_there():
    bare = pages(contents())["START-HERE.html"]
    assert "documentation" not in bare
    assert "otebooks" not in bare
    assert "--pyodide" not in bare
    full = pages(contents(notebooks="notebooks", browser_lab="browser-lab", jupyter=True))
    assert "jupyter notebook notebooks" in full["START-HERE.html"]
    assert "taskrpc view --lab --pyodide browser-lab" in full["labs.html"]
    assert '"taskrpc[completion,simulate,tls,web]" notebook</code>' in full["install-macos.html"]


def test_labs_page_links_the_sheets_that_exist():
    made = pages(contents(sheets={1: "docs/teach/lab-1.html"}))["labs.html"]
    assert re.search(r'<td><a href="docs/teach/lab-1.html">1\. [^<]+</a></td><td>\d+</td>', made)
    assert "taskrpc lab start 1" in made


@pytest.mark.parametrize(
    ("given", "shown"),
    [(["3.12"], "3.12"), (["3.11", "3.12"], "3.11 or 3.12"), (["1", "2", "3"], "1, 2 or 3")],
)
def test_versions_are_a_list_in_words(given, shown):
    assert alternatives(given) == shown
