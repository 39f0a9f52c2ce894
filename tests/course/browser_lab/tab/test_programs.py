"""What a program of the tab writes, and what the page shows of its exceptions."""

import asyncio

import pytest

from taskrpc.course.browser_lab.tab import programs
from taskrpc.course.browser_lab.tab.programs import MAX_OUTPUT, Program, explained


class Tab:
    """Stands in for `Programs`: it keeps the events."""

    def __init__(self):
        self.events = []

    def emit(self, event, **values):
        self.events.append((event, values))

    @property
    def text(self):
        return "".join(values["text"] for event, values in self.events if event == "output")


@pytest.fixture
def program():
    return Program(Tab(), "server.py#1", "server.py")


def test_output_is_kept_as_lines_and_shown_as_it_comes(program):
    program.write("one\ntw", is_error=False)
    program.write("o\n", is_error=True)
    assert program.output == ["one", "two"]
    assert program._programs.text == "one\ntwo\n"


def test_a_flood_of_output_ends_with_one_remark(program):
    for _ in range(4):
        program.write("x" * (MAX_OUTPUT // 2) + "\n", is_error=False)
    text = program._programs.text
    assert len(text) < MAX_OUTPUT + 100
    assert text.count("no more is shown") == 1


async def test_a_line_is_found_when_it_comes_and_missed_after_the_timeout(program):
    waiting = asyncio.create_task(program.wait_for_line(r"sum=(\d+)", timeout=5))
    await asyncio.sleep(1)
    program.write("the sum=5\n", is_error=False)
    assert (await waiting)[1] == "5"
    assert await program.wait_for_line("nothing", timeout=5) is None
    assert await program.finished(timeout=1) is None


def test_an_exception_is_explained_with_the_students_lines_only(monkeypatch, tmp_path):
    monkeypatch.setattr(programs, "FOLDER", tmp_path)
    path = tmp_path / "server.py"
    path.write_text("import json\n\njson.loads('{')\n")
    with pytest.raises(ValueError, match="Expecting") as caught:
        exec(compile(path.read_text(), str(path), "exec"), {})
    lines = explained(caught.value).splitlines()
    assert [line for line in lines if "File" in line] == ['  File "server.py", line 3, in <module>']
    assert lines[-1].startswith("json.decoder.JSONDecodeError")


def test_a_syntax_error_names_the_students_file(monkeypatch, tmp_path):
    monkeypatch.setattr(programs, "FOLDER", tmp_path)
    with pytest.raises(SyntaxError) as caught:
        compile("def add(:\n", str(tmp_path / "server.py"), "exec")
    assert 'File "server.py", line 1' in explained(caught.value)
