"""Submissions that try to stop or to fool the grader."""

import os
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

from taskrpc.course.labs.grader import grade
from taskrpc.course.labs.sandbox.worker import Request
from taskrpc.course.labs.variants import Variant
from tests.labs.confined import CONFINED, needs_bubblewrap
from tests.labs.submissions import solution_of, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time]

SERVER = (solution_of(1) / "server.py").read_text().replace("@SERVICE@", "add_two_ints")
SUM = "response.sum = request.a + request.b"
INIT = "rclpy.init()"

STOPPERS = {
    "computes for ever": "while True: pass",
    "sleeps for ever": "import time; time.sleep(1e6)",
    "ignores signals": """
        import signal, time
        for each in (signal.SIGINT, signal.SIGTERM): signal.signal(each, signal.SIG_IGN)
        while True: time.sleep(1)
    """,
    "forks": """
        import os
        while True:
            try: os.fork()
            except OSError: pass
    """,
    "starts threads": """
        import threading, time
        while True: threading.Thread(target=time.sleep, args=(1e6,)).start()
    """,
    "takes memory": "a = []\nwhile True: a.append(bytearray(10**7))",
    "floods its output": "while True: print('x' * 10**6)",
    "floods its output without lines": """
        import os
        while True: os.write(2, b'x' * 10**6)
    """,
    "fills the disk": """
        import itertools
        for n in itertools.count():
            try: open(f'{n}.bin', 'wb').write(bytes(10**7))
            except OSError: pass
    """,
    "makes many files": """
        import itertools
        for n in itertools.count(): open(f'{n}.txt', 'w').close()
    """,
    "makes a deep folder": """
        import os
        while True:
            os.mkdir('d'); os.chdir('d')
    """,
    "ends at once": "import sys; sys.exit(0)",
    "ends without clean-up": "import os; os._exit(0)",
    "hangs in an exit function": """
        import atexit
        @atexit.register
        def hang():
            while True: pass
        raise SystemExit(0)
    """,
    "crashes": "import sys; sys.setrecursionlimit(10**9)\ndef f(): f()\nf()",
    "kills its parent": """
        import os, signal
        os.kill(os.getppid(), signal.SIGKILL)
    """,
    "kills its group": "import os, signal; os.killpg(0, signal.SIGKILL)",
    "ends the process of the checks": """
        import os, signal
        for pid in range(2, 2**16):
            try: os.kill(pid, signal.SIGKILL)
            except OSError: pass
    """,
    "closes all files": "import os; os.closerange(0, 256)",
    "removes its folders": """
        import os, shutil
        for each in ('XDG_RUNTIME_DIR', 'HOME', 'TMPDIR'): shutil.rmtree(os.environ[each])
        shutil.rmtree(os.getcwd())
    """,
    "writes no text": "import os; os.write(1, bytes(range(256)) * 9); raise SystemExit('\\x1b[2J')",
    "is no Python": "def add(:",
    "is nested too deeply": "(" * 100_000,
    "has zeros": "\0",
}

CHEATS = {
    "prints the report": SERVER.replace(SUM, "print('ok    the server adds (3 of 3)')"),
    "writes the report": SERVER.replace(
        SUM, 'import os; [os.write(n, b\'{"type":"result"}\\n\') for n in (1, 2)]'
    ),
    "answers a constant": SERVER.replace(SUM, "response.sum = 5"),
    "answers once": SERVER.replace(SUM, SUM + "\n        self.add = None; rclpy.shutdown()"),
    "changes the checks": SERVER.replace(SUM, "pass").replace(
        INIT,
        INIT
        + """
    import taskrpc.course.labs.grading, taskrpc.course.labs.checks.lab1 as checks
    taskrpc.course.labs.grading.Finding.passed = True
    vars(checks)['_adds'] = lambda trial: None
""",
    ),
    "replaces modules": SERVER.replace(SUM, "pass").replace(
        INIT, "import sys; rclpy.init(); sys.modules.clear()"
    ),
    "changes the clock": SERVER.replace(SUM, "pass").replace(
        INIT, INIT + "; import time; time.time = time.monotonic = lambda: 0.0"
    ),
    "is the checks' node": SERVER.replace(SUM, "response.sum = -1").replace("add_server", "check"),
    "reads the checks": SERVER.replace(
        SUM, "response.sum = len(open('/proc/%d/environ' % __import__('os').getppid()).read())"
    ),
    "writes another variant": SERVER.replace(SUM, "pass").replace(
        INIT, INIT + "; open('taskrpc-lab.json', 'w').write('{\"lab\": 1, \"variant\": \"x\"}')"
    ),
}  # fmt: skip


async def graded(folder, server):
    """Grade lab 1 with the client of the solution; returns the results by their titles."""
    source = folder / "ada"
    submission(1, solution_of(1), source, Variant())
    (source / "server.py").write_text(server)
    found = await grade(Request(str(source), confined=CONFINED), "ada")
    assert found.stopped == ""
    assert sum(each.points for each in found.results) == 10
    return {each.title: each for each in found.results}


@pytest.fixture(autouse=True)
def nothing_is_left(monkeypatch):
    """Each test has its own temporary folder; afterwards it is empty, and no process is there."""
    place = Path(tempfile.mkdtemp())
    monkeypatch.setenv("TMPDIR", str(place))
    yield
    assert [each for each in processes() if each.startswith(str(place))] == []
    assert list(place.iterdir()) == []
    place.rmdir()


def processes():
    """The working directories of all processes."""
    for each in Path("/proc").glob("[0-9]*/cwd"):
        try:
            yield os.readlink(each)
        except OSError:
            continue


@needs_bubblewrap
@pytest.mark.parametrize("code", STOPPERS.values(), ids=STOPPERS)
async def test_program_cannot_stop_the_grader(tmp_path, code):
    results = await graded(tmp_path, textwrap.dedent(code))
    assert not results["the server offers the service"].passed
    assert not results["the server adds"].passed
    assert results["the client prints the response"].passed


@needs_bubblewrap
@pytest.mark.parametrize("server", CHEATS.values(), ids=CHEATS)
async def test_program_cannot_fool_the_grader(tmp_path, server):
    assert server != SERVER
    results = await graded(tmp_path, server)
    assert not results["the server adds"].passed


@pytest.mark.parametrize(
    ("client", "title"),
    [("sys.stdout.write(' '.join(map(str, range(10_000, 100_000))))", "prints the response")],
    ids=["prints many numbers"],
)
async def test_client_cannot_fool_the_grader(tmp_path, client, title):
    submission(1, solution_of(1), tmp_path / "ada", Variant())
    path = tmp_path / "ada" / "client.py"
    quiet = path.read_text().replace("print(", "str(")
    path.write_text(f"import sys\n{client}\n{quiet}")
    found = await grade(Request(str(tmp_path / "ada"), confined=CONFINED), "ada")
    assert found.stopped == ""
    failed = [each.title for each in found.results if not each.passed]
    assert failed[0].endswith(title)


async def test_the_reason_of_an_end_is_told(tmp_path):
    results = await graded(tmp_path, STOPPERS["floods its output"])
    happened = results["the server offers the service"].happened
    assert "taskrpc lab check ended this program: it wrote more than 1 MB of output" in happened


async def test_a_mistake_in_the_syntax_is_told_with_its_line(tmp_path):
    results = await graded(tmp_path, "import rclpy\ndef add(:\n")
    happened = results["the server offers the service"].happened
    assert happened.startswith("server.py, line 2: invalid syntax: `def add(:`")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has such files in no folder")
async def test_a_submission_that_is_too_large_is_refused(tmp_path):
    source = tmp_path / "ada"
    submission(1, solution_of(1), source, Variant())
    with (source / "film.mp4").open("wb") as film:
        film.truncate(5 * 2**30)
    found = await grade(Request(str(source), confined=CONFINED), "ada")
    assert found.stopped.startswith("expected a submission of at most 20 MB, got more")
    assert (found.points, found.results) == (0, ())
