"""An invalid definition gives exactly the messages of the .txt file beside it.

After a deliberate change of a message, run
`UPDATE_REJECTED=1 pytest tests/srvgen/test_parser_rejected.py` and read the difference.
"""

import os
from pathlib import Path

import pytest

from srvgen.errors import DefinitionError
from srvgen.files.reading import KINDS, decode, kind_of, parse_definition

FOLDER = Path(__file__).parents[1] / "rejected"
FILES = sorted(path for kind in KINDS for path in FOLDER.glob(f"*.{kind}"))


def refusal(path):
    with pytest.raises(DefinitionError) as caught:
        parse_definition(
            decode(path.read_bytes()), "some_msgs", kind_of(path), path.stem, path=path.name
        )
    return f"{caught.value}\n"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_invalid_definition_gives_exactly_these_messages(path):
    expected = path.with_suffix(".txt")
    actual = refusal(path)
    if os.environ.get("UPDATE_REJECTED"):
        expected.write_text(actual, encoding="utf-8", newline="\n")
    assert actual == expected.read_text(encoding="utf-8")


def test_every_expected_message_belongs_to_a_definition():
    assert {path.stem for path in FOLDER.glob("*.txt")} == {path.stem for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_problem_points_into_its_line(path):
    with pytest.raises(DefinitionError) as caught:
        parse_definition(
            decode(path.read_bytes()), "some_msgs", kind_of(path), path.stem, path=path.name
        )
    for problem in getattr(caught.value, "problems", [caught.value]):
        assert problem.line == 0 or 1 <= problem.column <= len(problem.source_line) + 1
