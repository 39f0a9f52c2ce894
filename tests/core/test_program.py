"""A script that lets one of our errors escape ends with one message and a documented status."""

import asyncio
import os
import signal
import subprocess
import sys

import pytest

import srvgen
import taskrpc
import taskrpc.sync
from srvgen import DefinitionError
from taskrpc import errors, program
from taskrpc.core.transport.network import no_server
from taskrpc.core.transport.tcp.tcp_network import TcpNetwork

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
        "AddTwoInts_Request takes its fields by name: write AddTwoInts.Request(a=..., b=...)",
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
    text = "AddTwoInts_Request takes its fields by name: write Add.Request(a=..., b=...)\n"
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


def run_script(folder, text, **files):
    """Run a program beside some files; return its status and what it wrote to stderr."""
    for name, content in {"caller": text, **files}.items():
        (folder / f"{name}.py").write_text(content)
    script = folder / "caller.py"
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=folder, timeout=60
    )
    assert done.stdout == ""
    return done.returncode, done.stderr


def test_a_script_ends_with_the_status_of_the_table_and_a_hint(tmp_path):
    calling = (
        "import srvgen, taskrpc.sync\n"
        "Add = srvgen.load('example_interfaces/srv/AddTwoInts')\n"
        "with taskrpc.sync.Node('caller') as node:\n"
        "    node.create_client(Add, 'nobody', timeout=0.01).call(Add.Request())\n"
    )
    assert run_script(tmp_path, calling) == (
        4,
        "caller.py:4: ServiceUnavailable: no server offers /nobody\n"
        "  hint: no taskrpc program offers a service on this machine in domain 0; start one, for"
        " example taskrpc-server\n",
    )


@pytest.mark.real_time
async def test_an_unknown_service_gets_the_suggestions_of_the_commands():
    async with taskrpc.Node("server") as server, taskrpc.Node("caller") as node:
        server.create_service(AddTwoInts, "add_two_ints", lambda request, response: response)
        with pytest.raises(taskrpc.ServiceUnavailable) as caught:
            await node.create_client(AddTwoInts, "add_to_ints").call(AddTwoInts.Request())
        assert caught.value.service == "/add_to_ints"


@pytest.mark.parametrize("peers", [None, ["127.0.0.1:1"]])
async def test_only_the_registry_of_this_machine_gives_suggestions(peers):
    network = TcpNetwork(domain=3, peers=peers or ())
    error = no_server(network, "/add")
    assert error.service == ("" if peers else "/add")
    assert bool(program.suggestion(error)) is (peers is None)
    assert program.suggestion(ValueError()) == ""


@pytest.mark.parametrize(
    ("name", "script"),
    [
        ("concurrent", "import taskrpc.sync\n"),
        ("queue", "from taskrpc.spi import DaemonThreads\n"),
    ],
)
def test_a_file_that_hides_a_module_of_python_is_named(tmp_path, name, script):
    status, text = run_script(tmp_path, script, **{name: ""})
    file = tmp_path / f"{name}.py"
    assert status == 1
    assert text.startswith("caller.py:1: ")
    assert text.endswith(f"the file {file} hides Python's own module {name}; rename the file\n")
    assert text.count("\n") == 1


def test_a_missing_module_of_the_program_keeps_its_traceback(tmp_path):
    status, text = run_script(tmp_path, "import taskrpc\nimport helper_that_is_missing\n")
    assert status == 1
    assert text.startswith("Traceback (most recent call last):")


SERVER = """
import srvgen, taskrpc, taskrpc.sync
Add = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    return response
"""
ENDS_AT_ONCE = {
    "a service": "node.create_service(Add, 'add', add)",
    "a timer": "node.create_timer(1.0, print)",
    "a subscription": "node.create_subscription(srvgen.load('std_msgs/msg/String'), 'a', print)",
}


@pytest.mark.parametrize("what", ENDS_AT_ONCE)
def test_a_node_that_ends_before_a_callback_could_run_says_so(tmp_path, what):
    program = f"""{SERVER}
async def main():
    async with taskrpc.Node("adder") as node:
        {ENDS_AT_ONCE[what]}

taskrpc.run(main())
"""
    offered = ", which offers /add," if what == "a service" else ""
    text = f"the node adder{offered} ends before a callback of it could run; end its block with"
    assert run_script(tmp_path, program) == (0, f"{text} `await node.spin()`\n")


def test_a_blocking_node_that_ends_at_once_says_so(tmp_path):
    program = f"""{SERVER}
with taskrpc.sync.Node("adder") as node:
    node.create_service(Add, "add", add)
"""
    text = "the node adder, which offers /add, ends before a callback of it could run;"
    assert run_script(tmp_path, program) == (0, f"{text} end its block with `node.spin()`\n")


@pytest.mark.parametrize(
    "block",
    [
        "await node.create_client(Add, 'add').call(Add.Request())",
        "await asyncio.sleep(0)",
        "raise SystemExit(0)",
    ],
)
def test_a_node_whose_program_waited_or_failed_ends_in_silence(tmp_path, block):
    program = f"""{SERVER}
import asyncio

async def main():
    async with taskrpc.Node("adder") as node:
        node.create_service(Add, "add", add)
        {block}

taskrpc.run(main())
"""
    assert run_script(tmp_path, program) == (0, "")


def test_a_blocking_program_that_calls_itself_ends_in_silence(tmp_path):
    program = f"""{SERVER}
with taskrpc.sync.Node("adder") as node:
    node.create_service(Add, "add", add)
    node.create_client(Add, "add").call(Add.Request())
"""
    assert run_script(tmp_path, program) == (0, "")


def test_a_blocking_node_in_an_async_with_says_how_to_write_it():
    async def main():
        async with taskrpc.sync.Node("a"):
            pass

    with pytest.raises(taskrpc.TaskRpcError, match=r"write `with taskrpc.sync.Node\("):
        asyncio.run(main())


NATIVE = """
import srvgen, taskrpc
async def main():
    async with taskrpc.Node("c") as node:
        client = node.create_client(srvgen.load("std_srvs/srv/Trigger"), "absent")
        print("up", flush=True)
        while not await client.wait_for_service(timeout=0.05):
            print("waiting", flush=True)
taskrpc.run(main())
"""
BLOCKING = """
import srvgen, taskrpc.sync
with taskrpc.sync.Node("c") as node:
    client = node.create_client(srvgen.load("std_srvs/srv/Trigger"), "absent")
    print("up", flush=True)
    while not client.wait_for_service(timeout=0.05):
        print("waiting", flush=True)
"""


@pytest.mark.end_to_end
@pytest.mark.real_time
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no such signal")
@pytest.mark.parametrize("program", [NATIVE, BLOCKING], ids=["native", "blocking"])
@pytest.mark.parametrize("command", [["-c"], ["-m", "taskrpc", "run", "-c"]], ids=["python", "run"])
@pytest.mark.parametrize(
    ("number", "said"), [(signal.SIGINT, "KeyboardInterrupt\n"), (signal.SIGTERM, "")]
)
def test_a_signal_ends_a_loop_around_a_wait_in_one_line(program, command, number, said):
    with subprocess.Popen(
        [sys.executable, *command, program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "up\n"
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (-number, said)


def test_an_error_that_ends_a_thread_is_one_message_and_other_errors_keep_their_traceback(tmp_path):
    program = f"""{SERVER}
import threading

def call():
    node.create_client(Add, "absent").call(Add.Request())

with taskrpc.sync.Node("adder") as node:
    for work in (call, lambda: 1 / 0):
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
"""
    code, err = run_script(tmp_path, program)
    assert code == 0
    assert err.count("Traceback") == 1
    assert "ServiceUnavailable: no server offers /absent" in err.partition("Exception in thread")[0]
    assert err.endswith("ZeroDivisionError: division by zero\n")


def test_a_loop_of_a_thread_ends_with_its_node(tmp_path):
    program = f"""{SERVER}
import threading
begun = threading.Event()

def wait():
    while not client.wait_for_service(timeout=0.01):
        begun.set()

with taskrpc.sync.Node("adder") as node:
    client = node.create_client(Add, "absent")
    threading.Thread(target=wait).start()
    begun.wait()
"""
    code, err = run_script(tmp_path, program)
    assert (code, err.count("\n")) == (0, 1)
    assert err.endswith(": TaskRpcError: the client of /absent is destroyed\n")
