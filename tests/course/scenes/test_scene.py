"""The excerpt of a program: the lines that the class sees, and those at which it should look."""

import pytest

from taskrpc.course.scenes.scene import Excerpt, Line

PROGRAM = "import time\nbegin()\ncall()\nend()\nagain()\nagain()\n"


def test_excerpt_has_the_lines_with_their_numbers():
    excerpt = Excerpt("begin", "end", ("call",))
    assert excerpt.lines(PROGRAM) == [
        Line(2, "begin()", False),
        Line(3, "call()", True),
        Line(4, "end()", False),
    ]


def test_excerpt_is_moved_to_the_left():
    lines = Excerpt("for", "more", ()).lines("def f():\n    for x in y:\n        more()\n")
    assert [line.text for line in lines] == ["for x in y:", "    more()"]


@pytest.mark.parametrize(("part", "count"), [("again", 2), ("nowhere", 0)])
def test_text_must_be_in_one_line(part, count):
    with pytest.raises(ValueError, match=f"expected one line with '{part}', found {count}"):
        Excerpt("begin", part, ()).lines(PROGRAM)
