"""The lecturers' folder: solutions, wrong submissions and hidden checks, as the tests use them."""

from __future__ import annotations

import runpy
from pathlib import Path

from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.starter import filled, write_starter

LECTURERS = Path(__file__).parents[2] / "examples" / "labs"


def submission(number, source, folder, variant):
    """Write the starter files, the solution, and what a wrong submission changes of it."""
    write_starter(lab(number), variant, folder)
    for place in [solution_of(number), source]:
        write_over(number, place, folder, variant)


def write_over(number, source, folder, variant):
    """Write the files of a solution or of a wrong submission into a folder."""
    values = lab(number).values(variant)
    for path in (each for each in sorted(source.rglob("*")) if each.is_file()):
        target = folder / filled(path.relative_to(source).as_posix(), values)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(filled(path.read_text(encoding="utf-8"), values), encoding="utf-8")


def solution_of(number):
    """Return the folder with the solution of a lab."""
    return LECTURERS / f"lab{number}" / "solution"


def hidden_checks(number):
    """Return the hidden checks of a lab; none if it has none."""
    path = LECTURERS / f"lab{number}" / "hidden.py"
    return runpy.run_path(str(path))["CHECKS"] if path.exists() else ()
