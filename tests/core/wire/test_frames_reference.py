"""The page about the wire protocol has the numbers of the code."""

import functools
import importlib
from pathlib import Path

import pytest

from taskrpc.core.wire.frames import Flag, FrameType
from tests.docs.markdown import read_page

PAGE = read_page(Path(__file__).parents[3] / "docs/reference/wire-protocol.md")


@pytest.mark.parametrize(("title", "kind"), [("Frame types", FrameType), ("Flags", Flag)])
def test_a_table_of_numbers_has_all_members_of_its_enumeration(title, kind):
    told = {int(number): name for number, name, *_ in PAGE.rows(title)}
    assert told == {member.value: member.name for member in kind}, f"{PAGE.path}: {title}"


def test_every_figure_of_the_protocol_is_the_one_in_the_code():
    rows = PAGE.rows("Limits and times")
    assert len(rows) > 10
    for what, figure, home, *_ in rows:
        module, _, name = home.partition(":")
        value = functools.reduce(getattr, name.split("."), importlib.import_module(module))
        assert float(value) == number_in(figure), f"{what}: {value}"


def number_in(text):
    number, *unit = text.replace(",", "").split()
    scale = {"KiB": 1024, "MiB": 1024**2}
    assert not unit or unit[0] in {*scale, "s", "bytes", "calls"}, text
    return float(number) * scale.get("".join(unit), 1)
