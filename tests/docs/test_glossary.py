"""The documentation uses the field's terms, and the glossary defines each of them once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.markdown import read_page

ROOT = Path(__file__).parents[2]
GLOSSARY = ROOT / "docs" / "reference" / "glossary.md"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]

TERMS = """
    attempt availability backpressure call callback caller cancel change_feed client deadline
    deduplication discovery drain estimate eviction exactly_once fair_queue fair_share hand-off
    handler introspection_event lease observer quota refuse registry registry_entry request
    request_id response retry schedule sequence_number session snapshot subscription
    task_repository timeout unread_bytes write_buffer
""".split()
"""Terms that every reader of the project needs."""

BANNED = [
    "desk",
    "seldom",
    "patience",
    "surplus",
    "whoever",
    "whomever",
    "somebody",
    "who asks",
    "who calls",
    "is told",
    "are told",
    "is told so",
    "till then",
    "call(?:s|ed)? off",
    "g(?:ives?|iven|ave) up",
    "at work",
    "dribbles?",
]
"""Words for which the field has a better term, or that hide the actor."""


def _terms() -> list[str]:
    rows = re.findall(r"^\| ([^|]+?) \|", GLOSSARY.read_text(encoding="utf-8"), flags=re.M)
    return rows[1:]


def test_the_glossary_defines_every_term_once_and_in_alphabetical_order():
    terms = _terms()
    assert terms == sorted(set(terms), key=str.lower)


def test_the_glossary_has_every_term_that_a_reader_needs():
    assert {term.replace("_", " ") for term in TERMS} <= set(_terms())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_uses_no_banned_word(page):
    prose = re.sub(r"`[^`]*`", "", read_page(page).prose)
    found = [
        f"{page.name}:{prose.count(chr(10), 0, match.start()) + 1}: {match[0]}"
        for match in re.finditer(rf"\b(?:{'|'.join(BANNED)})\b", prose, flags=re.I)
    ]
    assert not found, "\n".join(found)


def test_the_changelog_has_one_release_and_short_lines():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    groups = re.findall(r"^### (.*)$", text, flags=re.M)
    assert groups == ["Added", "Changed", "Fixed", "Migration"]
    assert not [line for line in text.splitlines() if len(line) > 100]
