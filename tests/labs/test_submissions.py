"""Each solution passes its lab, and each wrong submission gets the message that explains it."""

import re

import pytest

from taskrpc.course.labs.catalogue import LABS
from taskrpc.course.labs.grader import grade
from taskrpc.course.labs.sandbox.worker import Request
from taskrpc.course.labs.variants import Variant
from tests.labs.confined import CONFINED
from tests.labs.submissions import LECTURERS, solution_of, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time]
WRONG = sorted(LECTURERS.glob("lab*/wrong/*"))
PASSES_WITHOUT_HIDDEN_CHECKS = sorted(LECTURERS.glob("lab*/hidden_wrong/*"))
_MESSAGE = re.compile(r"# The check says: (.*)")


async def problems(number, folder, variant, *, hidden=False):
    """Return the titles of the checks that failed, as `taskrpc lab check` runs them, and why."""
    request = Request(
        str(folder), number, variant.id, str(LECTURERS) if hidden else None, confined=CONFINED
    )
    graded = await grade(request, "ada")
    assert graded.stopped == ""
    failed = [each for each in graded.results if not each.passed]
    return [
        (each.title, f"expected {each.expected}; {each.happened}; {each.look}") for each in failed
    ]


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
    hidden = id != ""  # once is enough: they take long
    assert await problems(each.number, tmp_path, Variant(id), hidden=hidden) == []


@pytest.mark.parametrize("wrong", WRONG, ids=name_of)
async def test_wrong_submission_gets_its_message(wrong, tmp_path):
    number = number_of(wrong)
    submission(number, wrong, tmp_path, Variant("grace"))
    found = await problems(number, tmp_path, Variant("grace"))
    assert found, "the checks accept it"
    assert expected_message(wrong) in found[0][1]


async def test_a_wrong_integer_type_in_lab_2_fails_one_check(tmp_path):
    wrong = LECTURERS / "lab2" / "wrong" / "integer_of_another_size"
    submission(2, wrong, tmp_path, Variant("grace"))
    found = await problems(2, tmp_path, Variant("grace"))
    assert [title for title, _ in found] == ["the definition has the fields of the steps"]


@pytest.mark.parametrize("wrong", PASSES_WITHOUT_HIDDEN_CHECKS, ids=name_of)
async def test_hidden_checks_find_what_the_public_ones_accept(wrong, tmp_path):
    number = number_of(wrong)
    submission(number, wrong, tmp_path, Variant("grace"))
    assert await problems(number, tmp_path, Variant("grace")) == []
    found = await problems(number, tmp_path, Variant("grace"), hidden=True)
    assert found, "the hidden checks accept it"
    assert expected_message(wrong) in f"{found[0][0]}: {found[0][1]}"
