"""A script that lets one of our errors escape ends with one message and a documented status."""

import os
import subprocess
import sys

import pytest

import srvgen
import taskrpc
from srvgen import DefinitionError
from taskrpc import errors

THIS_FILE = os.path.relpath(__file__)
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


@pytest.fixture
def ended(monkeypatch, capsys):
    """Runs a function as the last line of a script; gives the exit status and stderr's text."""
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    errors.show_in_one_message()

    def run(function):
        status = 1  # Python's own after an excepthook
        try:
            function()
        except Exception as error:
            try:
                sys.excepthook(type(error), error, error.__traceback__)
            except SystemExit as end:
                status = end.code
        return status, capsys.readouterr().err

    return run


def raising(error):
    def script():
        raise error

    return script


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (taskrpc.NameInUse("/add is taken"), 1),
        (taskrpc.InvalidRequest("a", "expected int64, got 'x'"), 1),
        (taskrpc.DeadlineExceeded("no answer"), 3),
        (taskrpc.DeadlineExceeded("not sent", not_executed=True), 4),
        (taskrpc.ServiceUnavailable("no server offers /add"), 4),
        (taskrpc.ServerBusy("full"), 4),
        (taskrpc.ConnectionLost("not sent", not_executed=True), 4),
        (taskrpc.OutcomeUnknown("lost"), 5),
        (taskrpc.TaskRpcError("the node a has not started"), 1),
    ],
)
def test_an_error_of_ours_is_one_message_with_its_place(ended, error, status):
    line = raising(error).__code__.co_firstlineno + 1
    found, text = ended(raising(error))
    assert found == status
    assert text.startswith(f"{THIS_FILE}:{line}: {type(error).__name__}: ")
    assert text.endswith(f"{error}\n")
    assert text.count("\n") == 1


def test_each_error_of_a_task_group_is_one_message(ended):
    errors = [taskrpc.ServiceUnavailable("no server offers /add"), taskrpc.ConnectionLost("gone")]
    status, shown = ended(raising(ExceptionGroup("unhandled errors in a TaskGroup", errors)))
    assert status == 4
    assert [line.split(": ", 1)[1] for line in shown.splitlines()] == [
        "ServiceUnavailable: no server offers /add",
        "ConnectionLost: gone",
    ]


def test_a_group_with_an_error_of_the_script_keeps_its_traceback(ended):
    errors = [taskrpc.ConnectionLost("gone"), TypeError("no")]
    status, shown = ended(raising(ExceptionGroup("unhandled errors in a TaskGroup", errors)))
    assert status == 1
    assert "Traceback" in shown


def test_hints_are_part_of_the_message(ended):
    error = taskrpc.ServiceUnavailable("no server offers /add")
    error.add_note("start it")
    assert ended(raising(error))[1].endswith("no server offers /add\n  hint: start it\n")


def test_a_definition_with_a_mistake_is_one_message(ended):
    status, text = ended(lambda: srvgen.parse_srv("int7 a\n---\n", "pkg", "Bad"))
    assert status == 1
    assert "Traceback" not in text
    assert f": {DefinitionError.__name__}: " in text


def test_a_programming_error_keeps_its_traceback(ended):
    status, text = ended(lambda: taskrpc.creat_node)
    assert status == 1
    assert text.startswith("Traceback (most recent call last):")


def test_at_the_prompt_the_message_ends_nothing(ended, monkeypatch):
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    assert ended(raising(taskrpc.OutcomeUnknown("lost")))[0] == 1


def test_an_excepthook_of_the_program_stays(monkeypatch):
    def own(*_):
        pass

    monkeypatch.setattr(sys, "excepthook", own)
    taskrpc.Node("a")
    assert sys.excepthook is own


@pytest.mark.parametrize("make", [taskrpc.Node, taskrpc.sync.Node])
def test_a_node_is_enough_to_have_errors_in_one_message(monkeypatch, make):
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    make("a")
    assert sys.excepthook is not sys.__excepthook__


async def main():
    pass


MISUSES = {
    "a function instead of a coroutine": (
        lambda: taskrpc.run(main),
        "taskrpc.run: expected a coroutine, got the function main; write taskrpc.run(main())",
    ),
    "a value instead of a coroutine": (
        lambda: taskrpc.run(None),
        "taskrpc.run: expected a coroutine, got None; write taskrpc.run(main())",
    ),
    "with": (
        lambda: taskrpc.Node("a").__enter__(),
        "taskrpc.Node is asynchronous: write `async with taskrpc.Node(...) as node:`,"
        " or `with taskrpc.sync.Node(...) as node:` in a program without async",
    ),
    "positional fields": (
        lambda: AddTwoInts.Request(1, 2),
        "a message takes its fields by name: write Request(a=1, b=2), not Request(1, 2)",
    ),
}


@pytest.mark.parametrize("misuse", MISUSES)
def test_a_misuse_is_one_line_with_the_cure(ended, misuse):
    use, text = MISUSES[misuse]
    status, said = ended(use)
    assert status == 1
    assert said.endswith(f"Error: {text}\n")
    assert said.count("\n") == 1


def test_a_node_in_a_plain_with_says_how_to_write_it():
    with pytest.raises(taskrpc.TaskRpcError, match="async with"), taskrpc.Node("a"):
        pass


@pytest.mark.parametrize(
    "load",
    [
        "import srvgen\nAdd = srvgen.load('example_interfaces/srv/AddTwoInts')",
        "import srvgen\nsrvgen.install_import_hook()\n"
        "from example_interfaces.srv import AddTwoInts as Add",
    ],
)
def test_positional_fields_are_explained_in_a_script_without_a_node(tmp_path, load):
    script = tmp_path / "caller.py"
    script.write_text(f"{load}\nAdd.Request(1, 2)\n")
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=tmp_path, timeout=60
    )
    text = "a message takes its fields by name: write Request(a=1, b=2), not Request(1, 2)\n"
    line = load.count("\n") + 2
    assert (done.returncode, done.stderr) == (1, f"caller.py:{line}: TypeError: {text}")


@pytest.mark.parametrize("node_first", [True, False])
def test_loading_a_type_keeps_the_statuses_of_taskrpc(monkeypatch, node_first):
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    uses = [lambda: taskrpc.Node("a"), lambda: srvgen.load("std_srvs/srv/Trigger")]
    for use in uses if node_first else reversed(uses):
        use()
    error = taskrpc.OutcomeUnknown("lost")
    with pytest.raises(SystemExit) as ended:
        sys.excepthook(type(error), error, None)
    assert ended.value.code == 5


async def test_positional_fields_are_explained_where_a_node_sees_them():
    with pytest.raises(TypeError, match="by name"):
        async with taskrpc.Node("a", transport="memory"):
            AddTwoInts.Request(1, 2)


async def test_run_in_a_running_loop_suggests_await():
    with pytest.raises(taskrpc.WouldDeadlock, match=r"write `await main\(\)` there"):
        taskrpc.run(main())


def test_a_script_ends_with_the_status_of_the_table(tmp_path):
    script = tmp_path / "caller.py"
    script.write_text(
        "import srvgen, taskrpc.sync\n"
        "Add = srvgen.load('example_interfaces/srv/AddTwoInts')\n"
        "with taskrpc.sync.Node('caller') as node:\n"
        "    node.create_client(Add, 'nobody', timeout=0.01).call(Add.Request())\n"
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=tmp_path, timeout=60
    )
    said = "caller.py:4: ServiceUnavailable: no server offers /nobody\n"
    assert (done.returncode, done.stdout, done.stderr) == (4, "", said)
