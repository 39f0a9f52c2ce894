"""Each sheet of a lab is true: its blocks run with the starter files, then with the solution."""

from pathlib import Path

import pytest

from taskrpc.course.labs.catalogue import LABS
from taskrpc.course.labs.variants import Variant
from tests.docs.markdown import read_page
from tests.docs.stage import Stage
from tests.labs.submissions import solution_of, write_over

SHEETS = Path(__file__).parents[2] / "docs" / "teach"
every_lab = pytest.mark.parametrize("lab", LABS, ids=lambda lab: f"lab{lab.number}")


def sheet_of(lab):
    return read_page(SHEETS / f"lab-{lab.number}.md")


class SheetStage(Stage):
    """A stage on which the student has finished the lab at the block with the note `finished`."""

    def __init__(self, folder, lab):
        super().__init__(folder)
        self._number = lab.number

    def _play(self, block):
        if "finished" in block.notes:
            write_over(self._number, solution_of(self._number), self.folder, Variant())
        super()._play(block)


@pytest.mark.labs
@pytest.mark.real_time
@every_lab
def test_blocks_of_a_sheet_give_the_output_that_it_shows(lab, tmp_path):
    SheetStage(tmp_path, lab).play(sheet_of(lab))


@every_lab
def test_sheet_has_the_title_the_goal_and_the_minutes_of_its_lab(lab):
    text = " ".join(sheet_of(lab).text.split())
    assert text.casefold().startswith(f"# lab {lab.number}: {lab.title.casefold()} ")
    assert lab.goal in text
    assert f"bout {lab.minutes} minutes" in text


@every_lab
def test_sheet_does_not_contain_the_solution(lab):
    text = sheet_of(lab).text
    for path in solution_of(lab.number).glob("*.py"):
        program = path.read_text(encoding="utf-8")
        assert program not in text
