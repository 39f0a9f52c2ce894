"""Processes that grade a submission: how they end, and what they cannot see."""

import asyncio
import contextlib
import os
import signal
import sys
import tempfile
from pathlib import Path

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.labs import catalogue, grader
from taskrpc.course.labs.report import About, Graded, Result, Slower
from taskrpc.course.labs.sandbox.worker import Request
from taskrpc.course.labs.starter import write_starter
from taskrpc.course.labs.variants import Variant
from tests.labs.confined import needs_bubblewrap
from tests.labs.submissions import solution_of, submission

labs = [pytest.mark.labs, pytest.mark.real_time]


def graded(request, student):
    return Graded(student, About(1, ""), (Result("adds", 1, True),), 1, "", 0.1)


@pytest.mark.labs
@pytest.mark.real_time
async def test_checks_end_at_once_if_nobody_reads_their_results(tmp_path):
    def on_result(result):
        seen.append(result)
        raise BrokenPipeError

    seen = []
    write_starter(catalogue.lab(1), Variant(), tmp_path)
    with pytest.raises(BrokenPipeError):
        await grader.grade(Request(str(tmp_path)), "ada", on_result)
    assert len(seen) == 1


@pytest.fixture
def in_memory(monkeypatch):
    """Grade without processes; returns how many were graded at the same time at most."""
    counts = [0, 0]

    async def grade(request, student, on_result=lambda _: None):
        counts[0] += 1
        counts[1] = max(counts)
        await asyncio.sleep(1)
        counts[0] -= 1
        return graded(request, student)

    monkeypatch.setattr(grader, "grade", grade)
    return counts


async def test_as_many_submissions_as_jobs_are_graded_at_the_same_time(in_memory):
    sources = [Path(f"{number}.zip") for number in range(5)]
    found = [
        each.student
        async for _, each in grader.grade_all(sources, lambda source: Request(str(source)), 2)
    ]
    assert sorted(found) == ["0", "1", "2", "3", "4"]
    assert in_memory[1] == 2


async def test_a_failure_of_the_grader_is_not_that_of_the_others(in_memory, monkeypatch):
    async def grade(request, student, on_result=lambda _: None):
        if student == "1":
            raise OSError("no memory for a process")
        return graded(request, student)

    monkeypatch.setattr(grader, "grade", grade)
    sources = [Path(f"{number}.zip") for number in range(3)]
    found = {
        each.student: each.stopped
        async for _, each in grader.grade_all(sources, lambda source: Request(str(source)), 2)
    }
    assert found == {"0": "", "1": "cannot be graded: no memory for a process", "2": ""}


@pytest.mark.parametrize(
    ("slow", "told_at", "seconds", "code"),
    [
        (1.0, None, 89.0, 0),
        (1.0, None, 91.0, None),
        (4.0, None, 179.0, 0),  # the machine is busy before the checks can say so
        (1.0, 80.0, 179.0, 0),  # the checks say so before the first limit
        (1.0, 80.0, 181.0, None),
    ],
)
async def test_a_submission_has_more_time_on_a_busy_machine(
    slow, told_at, seconds, code, monkeypatch
):
    class Tree:
        async def wait(self):
            await asyncio.sleep(seconds)
            return 0

    lines = []
    monkeypatch.setattr(grader, "slowness", lambda: slow)
    if told_at is not None:
        asyncio.get_running_loop().call_later(told_at, lines.append, Slower(2.0))
    assert await grader._end(Tree(), lines) == code


def test_submissions_are_folders_and_zip_files(tmp_path):
    for name in ("bob", ".git"):
        (tmp_path / name).mkdir()
    for name in ("ada.zip", "list.csv"):
        (tmp_path / name).touch()
    assert [each.name for each in grader.submissions(tmp_path)] == ["ada.zip", "bob"]


def test_a_folder_without_submissions_is_named(tmp_path):
    with pytest.raises(TaskRpcError, match=r"--all: expected a folder or \.zip file for each"):
        grader.submissions(tmp_path)
    with pytest.raises(TaskRpcError, match="--all: expected a folder with the submissions"):
        grader.submissions(tmp_path / "none")


def lab_1(folder, **files):
    write_starter(grader.catalogue.lab(1), Variant(), folder)
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def running(name):
    """Whether a process of this name runs."""
    for each in Path("/proc").glob("[0-9]*/comm"):
        with contextlib.suppress(OSError):
            if each.read_text().strip() == name:
                return True
    return False


class TestProcesses:
    pytestmark = labs

    @pytest.mark.skipif(sys.platform != "linux", reason="uses signals, and looks at processes")
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
    @pytest.mark.parametrize("has_sandbox", [False, pytest.param(True, marks=needs_bubblewrap)])
    async def test_nothing_is_left_when_the_command_is_ended(self, number, has_sandbox, tmp_path):
        name = f"server{os.getpid()}"  # of the process, so that this test finds it
        server = f"open('/proc/self/comm', 'w').write({name!r})\nimport time\ntime.sleep(1e6)"
        lab_1(tmp_path, server=server)
        place = Path(tempfile.mkdtemp())
        environment = {**os.environ, "TMPDIR": str(place)}
        if not has_sandbox:
            environment["PATH"] = "/nowhere"
        command = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "taskrpc", "lab", "check"),
            cwd=tmp_path,
            env=environment,
            stderr=asyncio.subprocess.PIPE,
        )
        while not running(name):
            await asyncio.sleep(0.01)
        command.send_signal(number)
        _, errors = await command.communicate()
        assert command.returncode == (130 if number == signal.SIGINT else -number)
        assert errors == b""
        while list(place.iterdir()) or running(name):
            await asyncio.sleep(0.01)
        place.rmdir()

    async def test_a_check_that_fails_once_keeps_its_points_and_says_so(self, tmp_path):
        marker = tmp_path / "has run"
        server = (solution_of(1) / "server.py").read_text().replace("@SERVICE@", "add_two_ints")
        server = (
            "import pathlib, sys\n"
            f"marker = pathlib.Path({str(marker)!r})\n"
            "if not marker.exists(): marker.touch(); sys.exit('too busy')\n"
        ) + server
        source = tmp_path / "ada"
        submission(1, solution_of(1), source, Variant())
        (source / "server.py").write_text(server)
        found = await grader.grade(Request(str(source)), "ada")
        first, *others = found.results
        assert (found.points, found.most) == (10, 10)
        assert first.remark.startswith("passed at the second run")
        assert [each.remark for each in others] == [""] * 4

    async def test_a_check_runs_twice_only_if_its_result_can_depend_on_time(self, tmp_path):
        source = lab_1(tmp_path / "ada", server="def f(:", client="raise SystemExit(0)")
        found = await grader.grade(Request(str(source)), "ada")
        remarks = {each.title: each.remark for each in found.results}
        assert remarks["the server offers the service"] == ""
        assert remarks["the client prints the response"] == "failed twice"

    @needs_bubblewrap
    async def test_a_program_cannot_read_the_hidden_checks(self, tmp_path):
        hidden = tmp_path / "lecturer" / "lab1" / "hidden.py"
        hidden.parent.mkdir(parents=True)
        hidden.write_text(
            "from taskrpc.course.labs.lab import Check, NotMet\n"
            "async def run(trial):\n"
            "    program = await trial.start('server.py')\n"
            "    await program.finished(20)\n"
            "    raise NotMet('', ' '.join(program.output), '')\n"
            "CHECKS = (Check('hidden', 2, run),)\n"
        )
        source = lab_1(tmp_path / "ada", server=f"print(open({str(hidden)!r}).read())")
        request = Request(str(source), hidden=str(tmp_path / "lecturer"), confined=True)
        found = await grader.grade(request, "ada")
        last = found.results[-1]
        assert (last.title, last.hidden, found.most) == ("hidden", True, 12)
        assert "FileNotFoundError" in last.happened

    @pytest.mark.parametrize(
        ("request_of", "words"),
        [
            ({"lab": 4}, "expected lab 4, but this folder contains lab 1"),
            ({"source": "nowhere"}, "expected a folder or a .zip file with a submission"),
        ],
    )
    async def test_what_cannot_be_checked_is_told(self, request_of, words, tmp_path):
        request = Request(**{"source": str(lab_1(tmp_path)), **request_of})
        found = await grader.grade(request, "ada")
        assert words in found.stopped
        assert found.results == ()

    async def test_a_folder_without_a_record_needs_the_number(self, tmp_path):
        (tmp_path / "server.py").write_text("")
        found = await grader.grade(Request(str(tmp_path)), "ada")
        assert "it has no taskrpc-lab.json" in found.stopped
        found = await grader.grade(Request(str(tmp_path), lab=1), "ada")
        about = found.about
        assert (about.lab, about.variant, about.notes) == (1, "", ())
        assert len(about.digest) == len(about.structure) == 64
        assert found.results[0].happened.startswith("it ended with exit code 0")

    async def test_a_damaged_record_is_told_without_our_paths(self, tmp_path):
        lab_1(tmp_path)
        (tmp_path / "taskrpc-lab.json").write_bytes(b"\xff{")
        found = await grader.grade(Request(str(tmp_path)), "ada")
        assert found.stopped.startswith("taskrpc-lab.json is damaged")
