"""The files of the live page: small, complete, and allowed by its Content-Security-Policy."""

import re
from pathlib import Path

import pytest

import taskrpc.observe.web

STATIC = Path(taskrpc.observe.web.__file__).with_name("static")
FILES = sorted(path.name for path in STATIC.iterdir())
MODULES = [name for name in FILES if name.endswith(".js")]
OF_RECORDINGS = {"notes.js", "recording.js"}
ON_DEMAND = {"frames.js", "slow_motion.js", *OF_RECORDINGS}
"""Modules that a page loads when a robot publishes frames, in slow motion, and for a recording."""
MOST_BYTES_AT_FIRST, MOST_BYTES = 140_000, 150_000
"""Most bytes of the page when it opens, and of a live page that has loaded everything it can."""


def size(name: str) -> int:
    return (STATIC / name).stat().st_size


def text(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def loaded_with(name: str) -> set[str]:
    """Return the files that a browser loads with this one, at once."""
    patterns = (
        r'^import .* from "\./([\w.]+)"',
        r'<link rel="stylesheet" href="(.*?)"',
        r'src="(.*?)"',
    )
    found = {each for pattern in patterns for each in re.findall(pattern, text(name), re.MULTILINE)}
    return {name}.union(*map(loaded_with, found))


def test_page_is_small():
    first = loaded_with("index.html")
    assert first == set(FILES) - ON_DEMAND
    assert sum(size(name) for name in first) <= MOST_BYTES_AT_FIRST
    # A live page plays no recording.
    assert sum(size(name) for name in set(FILES) - OF_RECORDINGS) <= MOST_BYTES


@pytest.mark.parametrize("name", FILES)
def test_file_loads_nothing_from_elsewhere(name):
    addresses = re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"')]*", text(name))
    namespaces = {"http://www.w3.org/2000/svg"}
    assert {each for each in addresses if each.startswith(("http", "//"))} <= namespaces


@pytest.mark.parametrize("name", MODULES)
def test_module_puts_text_on_the_page_only_as_text(name):
    """A task's target may contain markup."""
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", text(name)
    )


@pytest.mark.parametrize("name", MODULES)
def test_module_imports_names_that_exist(name):
    for names, module in re.findall(r"import \{([^}]*)\} from \"\./([\w.]+)\"", text(name)):
        exported = set(
            re.findall(r"export (?:async )?(?:class|const|function\*?) (\w+)", text(module))
        )
        assert {each.split()[0] for each in names.split(",")} <= exported, module


@pytest.mark.parametrize("name", MODULES)
def test_module_uses_each_imported_name(name):
    code = text(name)
    for names, _ in re.findall(r"import \{([^}]*)\} from \"\./([\w.]+)\"", code):
        for each in names.split(","):
            used = each.split()[-1]  # `name as used`
            assert len(re.findall(rf"\b{used}\b", code)) > 1, each


def test_html_has_no_inline_script_or_style():
    html = text("index.html")
    assert not re.search(r"<style|\sstyle=|\son\w+=|javascript:", html)
    assert re.findall(r"<script[^>]*>(.*?)</script>", html) == [""]


def test_elements_that_modules_look_up_are_in_the_html():
    html = text("index.html")
    ids = set(re.findall(r'\bid="([\w]+)"', html))
    wanted = {each for name in MODULES for each in re.findall(r'byId\("(\w+)"\)', text(name))}
    assert wanted <= ids


def test_states_of_tasks_have_a_tone_and_an_icon():
    from taskrpc.robot.tasks.model import TaskState

    html, words = text("index.html"), text("words.js")
    for state in TaskState:
        assert f'id="icon_{state.value}"' in html
        assert re.search(rf"^  {state.value}: \"\w+\",", words, re.MULTILINE)
