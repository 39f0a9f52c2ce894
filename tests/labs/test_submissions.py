"""Each solution passes its lab, and each wrong submission gets the message that explains it."""

import re
from pathlib import Path

import pytest

from taskrpc.labs.catalogue import LABS, lab
from taskrpc.labs.grading import findings
from taskrpc.labs.sandbox.child_trial import child_trial
from taskrpc.labs.starter import filled, write_starter
from taskrpc.labs.variants import Variant

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
LECTURERS = Path(__file__).parents[2] / "examples" / "labs"
WRONG = sorted(LECTURERS.glob("lab*/wrong/*"))
_MESSAGE = re.compile(r"# The check says: (.*)")


def submission(number, source, folder, variant):
    """Write the files of a solution, or those that a wrong submission changes, for a variant."""
    write_starter(lab(number), variant, folder)
    solution = LECTURERS / f"lab{number}" / "solution"
    values = lab(number).values(variant)
    for place in [solution, source]:
        for path in (each for each in sorted(place.rglob("*")) if each.is_file()):
            target = folder / filled(path.relative_to(place).as_posix(), values)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(filled(path.read_text(encoding="utf-8"), values), encoding="utf-8")


async def found(number, folder, variant):
    return [each async for each in findings(lab(number), lambda: child_trial(folder, variant))]


@pytest.mark.parametrize("id", ["", "ada"])
@pytest.mark.parametrize("each", LABS, ids=lambda each: f"lab{each.number}")
async def test_solution_passes(each, id, tmp_path):
    submission(each.number, LECTURERS / f"lab{each.number}" / "solution", tmp_path, Variant(id))
    results = await found(each.number, tmp_path, Variant(id))
    assert [(one.check.title, one.problem) for one in results if not one.passed] == []


@pytest.mark.parametrize("wrong", WRONG, ids=lambda path: f"{path.parts[-3]}-{path.name}")
async def test_wrong_submission_gets_its_message(wrong, tmp_path):
    number = int(wrong.parts[-3].removeprefix("lab"))
    submission(number, wrong, tmp_path, Variant("grace"))
    results = await found(number, tmp_path, Variant("grace"))
    problem = next((one.problem for one in results if one.problem), None)
    assert problem is not None, "the checks accept it"
    expected = [
        line[1]
        for path in sorted(wrong.rglob("*"))
        if path.is_file()
        for line in _MESSAGE.finditer(path.read_text(encoding="utf-8"))
    ]
    assert expected, f"{wrong} has no line `# The check says: ...`"
    assert expected[0] in str(problem)
