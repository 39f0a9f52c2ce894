"""What grading found, as text for students, as Gradescope's results.json and as CSV."""

from __future__ import annotations

import csv
import io
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec


class About(msgspec.Struct, frozen=True, tag="about"):
    """What is being graded: the first line of a grading process.

    Attributes:
        lab: the number of the lab.
        variant: the ID of the student's variant.
        digest: the same for submissions with the same files; "" for unchanged starter files.
        structure: the same for submissions that differ in names, comments and layout only; ""
            like `digest`.
        notes: what was left out of the submission, and why.
    """

    lab: int
    variant: str
    digest: str = ""
    notes: tuple[str, ...] = ()
    structure: str = ""


class Result(msgspec.Struct, frozen=True, tag="result"):
    """What a check found.

    Attributes:
        title: of the check.
        points: that a correct program gets.
        passed: whether the submission gets them.
        expected, happened, look: the message if the check ran and did not pass.
        waits_for: the title of the failed check that this one needs, "" if it ran.
        hidden: whether the check comes from the lecturer's own folder.
        remark: what the lecturer should know, such as that the check ran twice.
    """

    title: str
    points: float
    passed: bool
    expected: str = ""
    happened: str = ""
    look: str = ""
    waits_for: str = ""
    hidden: bool = False
    remark: str = ""


class Slower(msgspec.Struct, frozen=True, tag="slower"):
    """Time passes so many times slower than usual: the submission needs that much more time."""

    factor: float


class Stopped(msgspec.Struct, frozen=True, tag="stopped"):
    """Why the submission could not be checked, or not to the end."""

    reason: str


Line = About | Result | Slower | Stopped
"""What a grading process reports, one JSON text a line."""


class Graded(msgspec.Struct, frozen=True):
    """A graded submission.

    Attributes:
        student: the name of its folder or file.
        about: None if it could not be read at all.
        results: of the checks, as far as they were reached.
        most: the points of all checks.
        stopped: why the checks ended early, "" if they did not.
        seconds: that grading took.
    """

    student: str
    about: About | None
    results: tuple[Result, ...]
    most: float
    stopped: str
    seconds: float

    @property
    def points(self) -> float:
        """The points of all checks that passed."""
        return sum(each.points for each in self.results if each.passed)

    @property
    def passed(self) -> bool:
        """Whether everything is right."""
        return not self.stopped and all(each.passed for each in self.results)


def plain(text: str) -> str:
    """Return a text of a submission without control characters, so that it cannot act as one."""
    return "".join(
        each if each == "\t" or unicodedata.category(each) not in ("Cc", "Cf", "Cs", "Zl", "Zp")
        else each.encode("unicode_escape").decode()
        for each in text
    )  # fmt: skip


def number(value: float) -> str:
    """Return points as people write them: 3 or 2.5."""
    return f"{value:g}"


def lines_of(result: Result, *, colours: bool = False) -> list[str]:
    """Return the lines that tell a student what a check found."""
    word, colour = ("ok", 32) if result.passed else ("wait", 33) if result.waits_for else ("no", 31)
    mark = f"\x1b[{colour}m{word:<4}\x1b[0m" if colours else f"{word:<4}"
    got = number(result.points if result.passed else 0)
    lines = [f"{mark}  {result.title} ({got} of {number(result.points)})"]
    return lines + [f"      {line}" for line in _explanation(result)]


def _explanation(result: Result) -> list[str]:
    if result.waits_for:
        return [f"runs when this passes: {result.waits_for}"]
    if result.passed:
        return [result.remark] if result.remark else []
    happened = f"{result.happened} ({result.remark})" if result.remark else result.happened
    return [
        f"expected: {plain(result.expected)}",
        f"happened: {plain(happened)}",
        f"look:     {plain(result.look)}",
    ]


def summary(graded: Graded) -> list[str]:
    """Return the last lines: the points, and what to do next."""
    lines = [f"left out: {plain(note)}" for note in graded.about.notes] if graded.about else []
    if graded.stopped:
        lines.append(f"stopped: {plain(graded.stopped)}")
    lines.append(f"{number(graded.points)} of {number(graded.most)} points")
    failed = next((each for each in graded.results if not each.passed), None)
    if graded.passed:
        lines.append("Next: hand in the files of this folder, or go one step beyond in the sheet")
    elif failed is not None:
        lines.append(
            f'Next: correct "{failed.title}" first: read `look`, change one thing,'
            " run `taskrpc lab check` again"
        )
    return lines


def gradescope(graded: Graded) -> dict[str, Any]:
    """Return the content of Gradescope's results.json."""
    found: dict[str, Any] = {
        "score": graded.points,
        "execution_time": round(graded.seconds, 3),
        "output": "\n".join(
            plain(line)
            for line in ([graded.stopped] if graded.stopped else [])
            + (list(graded.about.notes) if graded.about else [])
        ),
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": [_gradescope_test(each) for each in graded.results],
    }
    return found


def _gradescope_test(result: Result) -> dict[str, Any]:
    return {
        "name": result.title,
        "score": result.points if result.passed else 0,
        "max_score": result.points,
        "status": "passed" if result.passed else "failed",
        "output": "\n".join(_explanation(result)),
        "visibility": "hidden" if result.hidden else "visible",
    }


def remarks(all_graded: Sequence[Graded]) -> list[str]:
    """Return what the lecturer should know about each submission."""
    remarks = []
    for one in all_graded:
        found = [one.stopped] if one.stopped else []
        found += _repeated(one)
        if one.about:
            found += _shared(one, one.about, all_graded)
            found += one.about.notes
        remarks.append("; ".join(found))
    return remarks


def _repeated(one: Graded) -> list[str]:
    """Return the remarks of its checks, each with the titles that have it."""
    titles: dict[str, list[str]] = {}
    for each in one.results:
        if each.remark:
            titles.setdefault(each.remark, []).append(each.title)
    return [f"{remark}: {', '.join(found)}" for remark, found in titles.items()]


def _shared(one: Graded, about: About, all_graded: Sequence[Graded]) -> list[str]:
    found = []
    others = [each for each in all_graded if each is not one and each.about]
    same_variant = [
        each.student for each in others if each.about and each.about.variant == about.variant
    ]
    if about.variant and about.variant != one.student:
        if about.variant in [each.student for each in others]:
            found.append(f"has the variant of {about.variant}")
        elif same_variant:
            found.append(f"has the same variant as {_names(same_variant)}")
    files = [each for each in others if each.about and about.digest == each.about.digest != ""]
    if files:
        found.append(f"identical files: {_names([each.student for each in files])}")
    programs = [
        each.student
        for each in others
        if each.about and about.structure == each.about.structure != "" and each not in files
    ]
    if programs:
        found.append(f"identical except for names, comments and layout: {_names(programs)}")
    return found


def _names(students: Sequence[str]) -> str:
    more = f" and {len(students) - 3} more" if len(students) > 3 else ""
    return ", ".join(students[:3]) + more


def as_csv(all_graded: Sequence[Graded]) -> str:
    """Return a table with a row for each submission, as text for a spreadsheet."""
    titles = list(dict.fromkeys(each.title for one in all_graded for each in one.results))
    output = io.StringIO()
    table = csv.writer(output, lineterminator="\n")
    table.writerow(["student", "lab", "variant", "points", "max", *titles, "seconds", "remark"])
    for one, remark in zip(all_graded, remarks(all_graded), strict=True):
        points = {each.title: number(each.points if each.passed else 0) for each in one.results}
        about = [str(one.about.lab), one.about.variant] if one.about else ["", ""]
        checks = [points.get(title, "") for title in titles]
        ends = [f"{one.seconds:.1f}", remark]
        row = [one.student, *about, number(one.points), number(one.most), *checks, *ends]
        table.writerow(_cells(row))
    return output.getvalue()


def _cells(texts: Iterable[str]) -> list[str]:
    """Cells that a spreadsheet does not take for formulas."""
    return [
        f"'{clean}" if clean.startswith(("=", "+", "-", "@", "\t")) else clean
        for clean in map(plain, texts)
    ]
