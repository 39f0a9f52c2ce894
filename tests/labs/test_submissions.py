"""Each solution passes its lab, and each wrong submission gets the message that explains it."""

import dataclasses
import re

import pytest

from taskrpc.labs.catalogue import LABS, lab
from taskrpc.labs.grading import findings
from taskrpc.labs.sandbox.child_trial import child_trial
from taskrpc.labs.variants import Variant
from tests.labs.submissions import LECTURERS, hidden_checks, solution_of, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
WRONG = sorted(LECTURERS.glob("lab*/wrong/*"))
PASSES_WITHOUT_HIDDEN_CHECKS = sorted(LECTURERS.glob("lab*/hidden_wrong/*"))
_MESSAGE = re.compile(r"# The check says: (.*)")


def with_hidden_checks(number):
    return dataclasses.replace(lab(number), checks=hidden_checks(number))


async def problems(chosen, folder, variant):
    """Return the checks that failed, each with its problem."""
    trial = lambda: child_trial(folder, variant)  # noqa: E731
    results = [each async for each in findings(chosen, trial)]
    return [(each.check.title, each.problem) for each in results if not each.passed]


def expected_message(source):
    """Return what the checks must say of a wrong submission."""
    files = sorted(path for path in source.rglob("*") if path.is_file())
    found = [_MESSAGE.search(path.read_text(encoding="utf-8")) for path in files]
    assert any(found), f"{source} has no line `# The check says: ...`"
    return next(each[1] for each in found if each)


def number_of(source):
    return int(source.parts[-3].removeprefix("lab"))


def name_of(source):
    return f"{source.parts[-3]}-{source.name}"


@pytest.mark.parametrize("id", ["", "ada"])
@pytest.mark.parametrize("each", LABS, ids=lambda each: f"lab{each.number}")
async def test_solution_passes(each, id, tmp_path):
    submission(each.number, solution_of(each.number), tmp_path, Variant(id))
    assert await problems(each, tmp_path, Variant(id)) == []


@pytest.mark.parametrize("wrong", WRONG, ids=name_of)
async def test_wrong_submission_gets_its_message(wrong, tmp_path):
    number = number_of(wrong)
    submission(number, wrong, tmp_path, Variant("grace"))
    found = await problems(lab(number), tmp_path, Variant("grace"))
    assert found, "the checks accept it"
    assert expected_message(wrong) in str(found[0][1])


@pytest.mark.parametrize("wrong", PASSES_WITHOUT_HIDDEN_CHECKS, ids=name_of)
async def test_hidden_checks_find_what_the_public_ones_accept(wrong, tmp_path):
    number = number_of(wrong)
    submission(number, wrong, tmp_path, Variant("grace"))
    assert await problems(lab(number), tmp_path, Variant("grace")) == []
    found = await problems(with_hidden_checks(number), tmp_path, Variant("grace"))
    assert found, "the hidden checks accept it"
    assert expected_message(wrong) in f"{found[0][0]}: {found[0][1]}"
