"""Results as text, as Gradescope's results.json and as CSV."""

import csv
import io

import pytest

from taskrpc.course.labs.report import (
    About,
    Graded,
    Result,
    as_csv,
    gradescope,
    lines_of,
    plain,
    remarks,
    summary,
)

PASSED = Result("the server adds", 3, True)
FAILED = Result("the server logs", 1.5, False, "a line", "none", "see get_logger")
WAITS = Result("the client prints", 2, False, waits_for="the server logs")


def graded(
    *results,
    student="ada",
    variant="",
    digest="",
    structure="",
    stopped="",
    notes=(),
    about=True,
    most=6.5,
):
    found = About(1, variant, digest, tuple(notes), structure) if about else None
    return Graded(student, found, results, most, stopped, 1.25)


def test_a_failed_check_says_what_was_expected_what_happened_and_where_to_look():
    assert lines_of(PASSED) == ["ok    the server adds (3 of 3)"]
    assert lines_of(FAILED) == [
        "no    the server logs (0 of 1.5)",
        "      expected: a line",
        "      happened: none",
        "      look:     see get_logger",
    ]
    assert lines_of(WAITS)[1] == "      runs when this passes: the server logs"


def test_only_the_mark_has_a_colour():
    assert lines_of(FAILED, colours=True)[0].startswith("\x1b[31mno  \x1b[0m  the server")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2Jok", "\\x1b[2Jok"),
        ("a\rok", "a\\rok"),
        ("\u202eko", "\\u202eko"),
        ("Zoë\t= 5 °C", "Zoë\t= 5 °C"),
        ("\ud800", "\\ud800"),
    ],
)
def test_output_of_a_program_cannot_control_the_terminal(text, shown):
    assert plain(text) == shown
    assert lines_of(Result("t", 1, False, "x", text, "y"))[2] == f"      happened: {shown}"


def test_the_summary_names_the_first_check_to_correct():
    lines = summary(graded(PASSED, FAILED, WAITS))
    assert lines[0] == "3 of 6.5 points"
    assert 'correct "the server logs" first' in lines[1]
    assert summary(graded(PASSED, most=3))[1].startswith("Next: hand in")


def test_gradescope_gets_its_fields():
    hidden = Result("more than two calls", 2, True, hidden=True)
    found = gradescope(graded(PASSED, FAILED, hidden, notes=["left out x (a link)"]))
    assert found["score"] == 5
    assert found["execution_time"] == 1.25
    assert found["output"] == "left out x (a link)"
    assert [each["status"] for each in found["tests"]] == ["passed", "failed", "passed"]
    assert [each["visibility"] for each in found["tests"]] == ["visible", "visible", "hidden"]
    assert [each["score"] for each in found["tests"]] == [3, 0, 2]
    assert found["tests"][1]["max_score"] == 1.5
    assert "expected: a line" in found["tests"][1]["output"]


def test_a_submission_that_could_not_be_checked_has_no_points_and_a_reason():
    one = graded(stopped="it is too large", about=False)
    assert not one.passed
    assert gradescope(one)["output"] == "it is too large"
    assert remarks([one]) == ["it is too large"]


def rows(*all_graded):
    return list(csv.DictReader(io.StringIO(as_csv(all_graded))))


def test_the_table_has_a_row_for_each_submission_and_a_column_for_each_check():
    first, second = rows(graded(PASSED, FAILED), graded(student="bob", about=False, stopped="x"))
    assert first == {
        "student": "ada",
        "lab": "1",
        "variant": "",
        "points": "3",
        "max": "6.5",
        "the server adds": "3",
        "the server logs": "0",
        "seconds": "1.2",
        "remark": "",
    }
    assert (second["points"], second["the server adds"], second["remark"]) == ("0", "", "x")


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "-1", "@x"])
def test_a_name_is_no_formula_in_a_spreadsheet(name):
    assert rows(graded(student=name))[0]["student"] == f"'{name}"


def test_the_variant_of_another_student_is_remarked():
    ada = graded(student="ada", variant="ada")
    bob = graded(student="bob", variant="ada")
    assert remarks([ada, bob]) == ["", "has the variant of ada"]
    assert remarks([graded(student="a", variant="7"), graded(student="b", variant="7")]) == [
        "has the same variant as b",
        "has the same variant as a",
    ]
    assert remarks([graded(student="a"), graded(student="b")]) == ["", ""]


def test_identical_files_are_remarked():
    some = [graded(student=name, digest="d") for name in "abcde"]
    assert remarks(some)[0] == "identical files: b, c, d and 1 more"


def test_a_check_that_ran_twice_is_remarked():
    busy = "passed at the second run: the machine was busy"
    passed = Result("it adds", 1, True, remark=busy)
    other = Result("it waits", 1, True, remark=busy)
    failed = Result("it logs", 1, False, "a line", "none", "see 5", remark="failed twice")
    assert lines_of(passed)[1:] == [f"      {busy}"]
    assert lines_of(failed)[2] == "      happened: none (failed twice)"
    found = remarks([graded(passed, failed, other)])
    assert found == [f"{busy}: it adds, it waits; failed twice: it logs"]


def test_the_same_program_with_other_names_is_remarked():
    some = [
        graded(student="ada", digest="1", structure="s"),
        graded(student="bob", digest="1", structure="s"),
        graded(student="cy", digest="2", structure="s"),
        graded(student="dora", digest="3", structure="t"),
        graded(student="eve"),
        graded(student="fay"),
    ]
    renamed = "identical except for names, comments and layout"
    assert remarks(some) == [
        f"identical files: bob; {renamed}: cy",
        f"identical files: ada; {renamed}: cy",
        f"{renamed}: ada, bob",
        "",
        "",
        "",
    ]
