import asyncio
import linecache

import pytest

import srvgen
from taskrpc.course.notebook.errors import OWN, lines_of
from taskrpc.errors import ServiceUnavailable, TaskRpcError


def place(file, line):
    return f"Cell In[3], line {line}: "


def raised(source, file="<cell>", **names):
    """The exception of a program, as a cell raises it."""
    try:
        exec(compile(source, file, "exec"), names)
    except BaseException as error:
        return error
    raise AssertionError("nothing was raised")


def test_error_of_taskrpc_takes_one_line():
    error = raised("x = 1\nraise error", "/home/ana/cell.py", error=ServiceUnavailable("no server"))
    assert lines_of(error, place) == ["Cell In[3], line 2: ServiceUnavailable: no server"]


def test_hints_of_an_error_are_kept():
    error = TaskRpcError("broken")
    error.add_note("repair it")
    assert lines_of(raised("raise error", "/a.py", error=error), place) == [
        "Cell In[3], line 1: TaskRpcError: broken\n  hint: repair it"
    ]


def test_error_of_a_definition_takes_one_line():
    error = raised("srvgen.load('no_such/srv/Type')", "/a.py", srvgen=srvgen)
    [line] = lines_of(error, place)
    assert line.startswith("Cell In[3], line 1: DefinitionError: ")


def test_group_of_errors_has_one_line_for_each():
    group = ExceptionGroup("two", [TaskRpcError("a"), TaskRpcError("b")])
    assert len(lines_of(raised("raise error", "/a.py", error=group), place)) == 2


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), TypeError("x"), KeyError("x")])
def test_error_of_the_student_keeps_its_traceback(error):
    assert lines_of(raised("raise error", "/a.py", error=error), place) == []


def test_positional_fields_are_explained(monkeypatch):
    request = srvgen.load("example_interfaces/srv/AddTwoInts").Request
    # Jupyter keeps the source of cells there.
    monkeypatch.setitem(linecache.cache, "/a.py", (13, None, ["request(1, 2)"], "/a.py"))
    [line] = lines_of(raised("request(1, 2)", "/a.py", request=request), place)
    assert "AddTwoInts_Request takes its fields by name: write request(a=..., b=...)" in line


@pytest.mark.parametrize("kind", [KeyboardInterrupt, asyncio.CancelledError])
def test_interrupt_while_taskrpc_waits_takes_one_line(kind):
    inner = {}
    exec(compile("def wait(error): raise error", f"{OWN}/sync/x.py", "exec"), inner)
    error = raised("wait(error)", "/a.py", wait=inner["wait"], error=kind())
    assert lines_of(error, place) == [
        "Cell In[3], line 1: KeyboardInterrupt: the cell was interrupted while it waited"
    ]


def test_interrupted_spin_names_the_way_to_spin_in_the_background():
    inner = {}
    exec(compile("def spin(node): raise KeyboardInterrupt", f"{OWN}/rclpy/x.py", "exec"), inner)
    [line] = lines_of(raised("spin(1)", "/a.py", spin=inner["spin"]), place)
    assert line.endswith(
        "hint: taskrpc.course.notebook.spin(node) spins a node while other cells run"
    )


def test_interrupt_of_the_students_own_loop_keeps_its_traceback():
    assert lines_of(raised("raise KeyboardInterrupt", "/a.py"), place) == []


def test_error_of_rclpy_takes_one_line():
    class RCLError(RuntimeError):
        __module__ = "rclpy._rclpy_pybind11"

    assert lines_of(raised("raise error", "/a.py", error=RCLError("twice")), place) == [
        "Cell In[3], line 1: RCLError: twice"
    ]


def test_wrong_argument_that_taskrpc_refuses_takes_one_line():
    inner = {}
    exec(compile("def refuse(): raise ValueError('no')", f"{OWN}/rclpy/x.py", "exec"), inner)
    error = raised("refuse()", "/a.py", refuse=inner["refuse"])
    assert lines_of(error, place) == ["Cell In[3], line 1: ValueError: no"]


def test_error_of_a_students_function_that_taskrpc_calls_keeps_its_traceback():
    inner = {}
    exec(compile("def call(callback): callback()", f"{OWN}/rclpy/x.py", "exec"), inner)
    error = raised("def own():\n    raise ValueError('no')\ncall(own)", "/a.py", call=inner["call"])
    assert lines_of(error, place) == []
