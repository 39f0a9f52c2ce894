"""The lecturer's page fits the slides, the scenes and three hours."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from taskrpc.course.scenes.catalogue import SCENES
from tests.docs.markdown import read_page

TEACH = Path(__file__).parents[2] / "docs" / "teach"
PAGE = read_page(TEACH / "README.md")
SLIDES = re.findall(r"^##? (.+)$", read_page(TEACH / "slides.md").prose, flags=re.M)


def _rows(title: str) -> list[list[str]]:
    """The cells of the table in a section, without its heading."""
    rows = re.findall(r"^\|(.*)\|$", PAGE.section(title), flags=re.M)[2:]
    return [[cell.strip() for cell in row.split("|")] for row in rows]


def test_the_running_order_takes_three_hours_and_each_part_begins_when_the_last_one_ends():
    now = 0
    for begin, minutes, *_ in _rows("Three hours"):
        hours, _, rest = begin.partition(":")
        assert 60 * int(hours) + int(rest) == now, begin
        now += int(minutes)
    assert now == 180


@pytest.mark.parametrize("section", ["Three hours", "Each concept and its place"])
def test_each_slide_that_the_page_names_exists(section):
    titles = re.findall(r"(?<!\*)\*([^*]+)\*(?!\*)", PAGE.section(section))
    missing = [title for title in titles if not any(each.startswith(title) for each in SLIDES)]
    assert not missing


def answered(slide: str) -> list[str]:
    """Return what stands behind the question of a slide; code, tables and lists do not count."""
    text = re.sub(r"```.*?```|<!--.*?-->|\?scene=", "", slide, flags=re.S)
    lines = [line for line in text.splitlines()[1:] if line.strip()]
    asks = [i for i, line in enumerate(lines) if "?" in line and line[0] not in "|123"]
    if not asks:
        return []
    rest = lines[asks[-1]].rpartition("?")[2]
    return [line for line in [rest, *lines[asks[-1] + 1 :]] if line.strip()]


def test_no_slide_shows_the_answer_with_its_question():
    deck = (TEACH / "slides.md").read_text(encoding="utf-8")
    slides = re.split(r"^## ", deck, flags=re.M)[1:]
    found = {slide.partition("\n")[0]: answered(slide) for slide in slides}
    assert {title: text for title, text in found.items() if text} == {}
    scenes = [slide for slide in slides if slide.startswith("Scene: ") and "![" not in slide]
    assert len(scenes) == 7
    assert [each for each in scenes if not each.rstrip().endswith("?")] == []
    titles = [slide.partition("\n")[0] for slide in slides]
    answers = [i for i, title in enumerate(titles) if title.startswith("Answer: ")]
    assert len(answers) == 10
    for i in answers:
        topic = titles[i].removeprefix("Answer: ")
        assert titles[i - 1].removeprefix("Scene: ").rstrip("?").lower() == topic.lower()


def test_an_answer_behind_its_question_is_found():
    question = "A title\n\nWhat happens with 257 in a `uint8`?"
    assert answered(question) == []
    assert answered(f"{question} The server gets 1.") == [" The server gets 1."]
    assert answered(f"{question}\n\n- The server gets 1.\n") == ["- The server gets 1."]


def test_every_scene_and_every_lab_has_its_place():
    cells = _rows("Each concept and its place")
    named = re.findall(r"`([\w-]+)`", " ".join(scene for *_, scene, _ in cells))
    assert {scene.name for scene in SCENES} <= set(named)
    assert {lab for *_, lab in cells if lab} == set("123456")
    slides = (TEACH / "slides.md").read_text(encoding="utf-8")
    assert all(f"taskrpc scene {scene.name}" in slides for scene in SCENES)


def test_the_slides_of_the_labs_have_the_minutes_of_the_running_order():
    slides = (TEACH / "slides.md").read_text(encoding="utf-8")
    for _, minutes, what, *_ in _rows("Three hours"):
        if found := re.search(r"\*\*Lab (\d)\*\*", what):
            _, _, slide = slides.partition(f"## Lab {found[1]}: ")
            assert f"{minutes} minutes." in slide.partition("\n## ")[0], what
