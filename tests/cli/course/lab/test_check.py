"""The options of `taskrpc lab check`, and what it prints."""

import asyncio
import csv
import json
import signal
from pathlib import Path

import pytest

from taskrpc.cli.main import main
from taskrpc.course.labs import grader
from taskrpc.course.labs.report import About, Graded, Result
from taskrpc.course.labs.sandbox import bubblewrap

PASSED = Result("the server adds", 3, True)
HIDDEN = "from taskrpc.course.labs.lab import Check\nCHECKS = (Check('hidden', 1, print),)\n"
FAILED = Result("the server logs", 1, False, "a line", "none\x1b[2J", "see get_logger")


@pytest.fixture(autouse=True)
def graded(monkeypatch, tmp_path):
    """Grade without processes: the results by the name of the submission."""
    found = {"ada": [PASSED], "bob": [PASSED, FAILED]}

    async def grade(request, student, on_result=lambda _: None):
        for each in found.get(student, []):
            on_result(each)
        about = About(1, "", "") if student in found else None
        stopped = "" if student in found else "it is too large"
        return Graded(student, about, tuple(found.get(student, [])), 4, stopped, 1.0)

    monkeypatch.setattr(grader, "grade", grade)
    monkeypatch.setattr(bubblewrap, "why_not", lambda: "")
    for name in ("ada", "bob", "eve"):
        (tmp_path / "class" / name).mkdir(parents=True)
    return tmp_path


def test_a_failed_check_is_explained_and_its_text_cannot_control_the_terminal(
    graded, monkeypatch, capsys
):
    monkeypatch.chdir(graded / "class" / "bob")
    assert main(["lab", "check"]) == 1
    output = capsys.readouterr().out
    assert "no    the server logs (0 of 1)\n      expected: a line\n" in output
    assert "happened: none\\x1b[2J\n" in output
    assert "3 of 4 points\nNext: correct" in output


def test_a_folder_that_cannot_be_checked_is_one_line(graded, monkeypatch, capsys):
    monkeypatch.chdir(graded / "class" / "eve")
    assert main(["lab", "check"]) == 1
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "it is too large\n")


@pytest.mark.parametrize("command", [["lab", "check"], ["lab", "start", "1"]])
def test_a_folder_that_was_removed_is_one_line(monkeypatch, capsys, command):
    def cwd():
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(Path, "cwd", cwd)
    assert main(command) == 2
    captured = capsys.readouterr()
    words = "the folder of this terminal does not exist any more: change to another one\n"
    assert (captured.out, captured.err) == ("", words)


def test_json_succeeds_also_for_a_wrong_submission(graded, monkeypatch, capsys):
    monkeypatch.chdir(graded / "class" / "bob")
    assert main(["lab", "check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["score"] == 3


def test_all_submissions_become_a_table(graded, capsys):
    table = graded / "points.csv"
    folder = str(graded / "class")
    assert main(["lab", "check", "--all", folder, "--csv", str(table), "--jobs", "2"]) == 0
    rows = list(csv.DictReader(table.read_text(encoding="utf-8-sig").splitlines()))
    assert [(row["student"], row["points"], row["remark"]) for row in rows] == [
        ("ada", "3", ""),
        ("bob", "3", ""),
        ("eve", "0", "it is too large"),
    ]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "3/3" in captured.err


@pytest.mark.parametrize("table", [[], ["--csv"], ["--csv", "points.csv"]])
def test_programs_of_other_people_need_a_sandbox(graded, monkeypatch, capsys, table):
    monkeypatch.chdir(graded)
    monkeypatch.setattr(bubblewrap, "why_not", lambda: "bubblewrap is not installed")
    assert main(["lab", "check", "--all", "class", *table]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert not (graded / "points.csv").exists()
    assert captured.err.count("\n") == 1
    for words in ("bubblewrap is not installed", "Debian package", "container", "--trusted"):
        assert words in captured.err
    assert main(["lab", "check", "--all", "class", *table, "--trusted"]) == 0


def test_own_work_needs_no_sandbox(graded, monkeypatch):
    monkeypatch.setattr(bubblewrap, "why_not", lambda: "bubblewrap is not installed")
    monkeypatch.chdir(graded / "class" / "ada")
    assert main(["lab", "check"]) == 0


@pytest.mark.parametrize("output", [[], ["--json"]])
@pytest.mark.parametrize("why_not", ["", "bubblewrap is not installed"])
def test_hidden_checks_without_a_sandbox_are_noted(graded, monkeypatch, capsys, output, why_not):
    monkeypatch.setattr(bubblewrap, "why_not", lambda: why_not)
    (graded / "labs" / "lab1").mkdir(parents=True)
    (graded / "labs" / "lab1" / "hidden.py").write_text(HIDDEN)
    monkeypatch.chdir(graded / "class" / "ada")
    assert main(["lab", "check", "--hidden", "../../labs", *output]) == 0
    noted = capsys.readouterr().err
    assert noted.count("\n") == bool(why_not)
    for words in ("bubblewrap is not installed", f"{graded / 'labs'}", "Debian package"):
        assert (words in noted) == bool(why_not)


def points_of(table):
    rows = csv.DictReader(table.read_text(encoding="utf-8-sig").splitlines())
    return {row["student"]: row["points"] for row in rows}


@pytest.fixture
def graded_now(monkeypatch):
    """The students who were graded, in order; Ctrl-C is typed before the third one."""
    names = []
    original = grader.grade

    async def grade(request, student, on_result=lambda _: None):
        if len(names) == 2:
            names.append("Ctrl-C")
            for _ in range(10):  # until the command has the results of the others
                await asyncio.sleep(0)
            signal.raise_signal(signal.SIGINT)
            await asyncio.Event().wait()
        names.append(student)
        return await original(request, student, on_result)

    monkeypatch.setattr(grader, "grade", grade)
    return names


def check_class(graded, *more):
    return main(["lab", "check", "--all", str(graded / "class"), "--jobs", "1", *more])


def test_interrupted_grading_keeps_what_is_done_and_the_same_command_continues(
    graded, graded_now, capsys
):
    (graded / "class" / "ada" / "server.py").write_text("pass")
    table = graded / "points.csv"
    assert check_class(graded, "--csv", str(table)) == 130
    assert points_of(table) == {"ada": "3", "bob": "3"}
    error = capsys.readouterr().err.splitlines()
    assert error[-1] == (
        "interrupted: 2 of 3 submissions are done; the same command goes on with the others"
    )
    graded_now.append("second run")
    assert check_class(graded, "--csv", str(table)) == 0
    assert graded_now[3:] == ["second run", "eve"]
    assert points_of(table) == {"ada": "3", "bob": "3", "eve": "0"}
    error = capsys.readouterr().err.splitlines()
    assert error[0].startswith("2 of 3 submissions are done and have not changed; to check them")
    assert error[1:] == ["3/3  eve: 0 of 4  it is too large"]


def test_only_changed_and_stopped_submissions_are_graded_again(graded, monkeypatch, graded_now):
    table = graded / "points.csv"
    graded_now += ["", "", ""]
    assert check_class(graded, "--csv", str(table)) == 0
    (graded / "class" / "bob" / "server.py").write_text("pass")
    assert check_class(graded, "--csv", str(table)) == 0
    assert graded_now[3:] == ["ada", "bob", "eve", "bob", "eve"]  # eve's is too large
    table.unlink()
    assert check_class(graded, "--csv", str(table)) == 0
    assert graded_now[8:] == ["ada", "bob", "eve"]


def test_another_lab_or_other_hidden_checks_are_graded_anew(graded, graded_now):
    table, hidden = graded / "points.csv", graded / "hidden" / "lab1" / "hidden.py"
    hidden.parent.mkdir(parents=True)
    graded_now += ["", "", ""]
    assert check_class(graded, "1", "--csv", str(table)) == 0
    for text in (
        "CHECKS = ()",
        "from taskrpc.course.labs.lab import Check\nCHECKS = (Check('', 1, id),)",
    ):
        del graded_now[3:]
        hidden.write_text(f"{text}\n")
        check_class(graded, "1", "--csv", str(table), "--hidden", str(hidden.parents[1]))
    assert graded_now[3:] == ["ada", "bob", "eve"]


def test_an_interruption_without_a_file_says_how_many_are_done(graded, graded_now, capsys):
    assert check_class(graded, "--csv") == 130
    captured = capsys.readouterr()
    assert [row["student"] for row in csv.DictReader(captured.out.splitlines())] == ["ada", "bob"]
    assert "interrupted: 2 of 3 submissions are done; they are in the table" in captured.err


def test_a_table_on_standard_output_is_not_mixed_with_progress(graded, capsys):
    assert main(["lab", "check", "--all", str(graded / "class"), "--csv"]) == 0
    assert capsys.readouterr().out.startswith("student,lab,variant,points,max,the server adds")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["9"], "there is no lab 9"),
        (["--csv"], "--csv needs --all FOLDER"),
        (["--jobs", "2"], "--jobs needs --all FOLDER"),
        (["--all", ".", "--json"], "--json is for one submission"),
        (["--all", ".", "--variant", "x"], "--variant is for one submission"),
        (["--trusted"], "--trusted needs --all FOLDER"),
        (["--all", ".", "--jobs", "0"], "--jobs: expected a number of at least 1, got 0"),
        (["--all", "nowhere"], "--all: expected a folder with the submissions"),
        (["--hidden", "nowhere"], "--hidden: expected a folder"),
        (["--hidden", "."], "--hidden: expected a folder with lab1/hidden.py, got"),
        (["--variant", "\udcff"], "--variant: expected text in UTF-8, got '\\udcff'"),
    ],
)
def test_arguments_that_do_not_fit_are_named(capsys, arguments, words):
    assert main(["lab", "check", *arguments]) in (1, 2)
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("number", ["4", "5", "6"])
def test_a_missing_package_is_one_line_with_the_command_that_installs_it(
    monkeypatch, capsys, tmp_path, number
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("taskrpc.course.labs.lab.find_spec", lambda name: None)
    assert main(["lab", "check", number]) == 1
    err = capsys.readouterr().err
    assert f"lab {number} is checked in virtual time, which needs greenlet, and that is" in err
    assert "pip install" in err
    assert err.count("\n") == 1
