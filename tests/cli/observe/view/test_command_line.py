"""`taskrpc view` finds the page of a running server, and never puts a token where others see it."""

import os
import signal
import subprocess
import sys
import time
import webbrowser

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.observe.view import command_line as view
from taskrpc.cli.shared.page_link import NotedLink, PageLink

LOCAL = PageLink(os.getpid(), "http://127.0.0.1:8642", "VIEW", "CONTROL")
REMOTE = PageLink(os.getpid(), "https://192.0.2.7:8642", "VIEW", "CONTROL")


@pytest.fixture
def opened(monkeypatch):
    found = []
    monkeypatch.setattr(webbrowser, "open", lambda url: found.append(url) or True)
    return found


@pytest.fixture
def note():
    noted = []

    def _note(link):
        noted.append(NotedLink(link))
        return noted[-1]

    yield _note
    for each in noted:
        each.close()


def test_link_for_control_is_opened_in_the_browser(note, opened, capsys):
    note(LOCAL)
    assert main(["view"]) == 0
    assert opened == ["http://127.0.0.1:8642/#control=CONTROL"]
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "the live page is at http://127.0.0.1:8642/\n")


def test_projector_gets_a_link_without_a_token(note, opened):
    note(LOCAL)
    assert main(["view", "--projector"]) == 0
    assert opened == ["http://127.0.0.1:8642/?projector"]


@pytest.mark.parametrize("arguments", [["--no-browser"], ["--no-browser", "--projector"]])
def test_links_are_printed_on_request(note, opened, capsys, arguments):
    note(LOCAL)
    assert main(["view", *arguments]) == 0
    assert opened == []
    assert capsys.readouterr().out.splitlines() == [
        "control:   http://127.0.0.1:8642/#control=CONTROL",
        "read-only: http://127.0.0.1:8642/",
        "projector: http://127.0.0.1:8642/?projector",
    ]


def test_links_are_printed_where_no_browser_can_be_opened(note, monkeypatch, capsys):
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    note(LOCAL)
    assert main(["view"]) == 0
    assert "#control=CONTROL" in capsys.readouterr().out


def test_token_of_a_page_for_other_machines_is_in_no_command_line(note, opened, capsys):
    note(REMOTE)
    assert main(["view"]) == 0
    assert opened == []
    assert capsys.readouterr().out.splitlines() == [
        "control:   https://192.0.2.7:8642/#control=CONTROL",
        "read-only: https://192.0.2.7:8642/#view=VIEW",
        "projector: https://192.0.2.7:8642/?projector#view=VIEW",
    ]


def test_server_that_cannot_start_is_reported(monkeypatch, capsys, opened):
    monkeypatch.setattr(view, "_START", "import sys; sys.exit('the port is taken')")
    assert main(["view"]) == 1
    assert "taskrpc-server could not start; the lines above say why" in capsys.readouterr().err
    assert opened == []


VIEW = "import sys; from taskrpc.__main__ import main; sys.exit(main())"
DEFAULT_ACTION = {
    "SIGINT": "signal.default_int_handler",
    "SIGTERM": "signal.SIG_DFL",
    "SIGHUP": "signal.SIG_DFL",
}


@pytest.mark.end_to_end
@pytest.mark.real_time
@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot send Ctrl-C to one process")
@pytest.mark.parametrize(("ending", "status"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_without_a_server_it_starts_one_and_ends_it(ending, status):
    # Under nohup this process ignores SIGHUP, and its children would do the same.
    code = f"import signal; signal.signal(signal.{ending}, {DEFAULT_ACTION[ending]})\n{VIEW}"
    command = [sys.executable, "-c", code, "view", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as viewing:
        lines = [viewing.stdout.readline() for _ in range(3)]
        assert lines[0].startswith(b"control:   http://127.0.0.1:")
        viewing.send_signal(getattr(signal, ending))
        try:
            _, said = viewing.communicate(timeout=60)
        finally:
            viewing.kill()
    assert viewing.returncode == status
    assert b"Traceback" not in said
    port = int(lines[1].rstrip(b"/\n").rpartition(b":")[2])
    with pytest.raises(OSError):  # noqa: PT011 (the system's own words)
        __import__("socket").create_connection(("127.0.0.1", port), timeout=5)


def test_a_signal_just_before_a_wait_for_the_server_is_not_lost():
    class Server:
        waits = 0

        def wait(self, timeout=None):
            self.waits += 1
            assert timeout is not None, "a wait without an end handles no recorded signal"
            if self.waits < 3:
                raise subprocess.TimeoutExpired("taskrpc-server", timeout)
            return 7

    assert view._status_of(Server()) == 7


@pytest.mark.real_time
def test_server_without_a_page_is_named(capsys):
    command = [sys.executable, "-m", "taskrpc.cli.robot.server.command_line", "--db", ":memory:"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        while "ready" not in server.stderr.readline():
            assert server.poll() is None
        assert main(["view"]) == 1
        said = capsys.readouterr().err
        server.terminate()
        server.communicate()
    assert "offers /robot_task, but has no live page" in said
    assert f"end it with `taskrpc stop {server.pid}`, and start it with --web 127.0.0.1:0" in said


def test_waiting_for_the_page_has_a_limit(monkeypatch):
    monkeypatch.setattr(view, "START_TIMEOUT", 0.2)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as silent:
        began = time.monotonic()
        with pytest.raises(view.TaskRpcError, match="did not serve its page within"):
            view._link_of(silent)
        assert time.monotonic() - began < 10
        silent.communicate(b"\n")


def test_page_of_the_first_robot_is_opened_unless_another_one_is_named(note, opened, capsys):
    second = PageLink(os.getpid(), "http://127.0.0.1:9", "VIEW", "CONTROL", "/robot2/robot_task")
    note(LOCAL)
    note(second)
    assert main(["view", "--no-browser"]) == 0
    assert "http://127.0.0.1:8642/#control" in capsys.readouterr().out
    assert main(["view", "--no-browser", "--service", "/robot2/robot_task"]) == 0
    assert "http://127.0.0.1:9/#control" in capsys.readouterr().out
    assert main(["view", "--service", "/robot3/robot_task"]) == 1
    said = capsys.readouterr().err
    assert said == (
        "no live page shows /robot3/robot_task; there are pages of: /robot2/robot_task,"
        " /robot_task\n"
    )


def test_service_without_any_page_is_not_found(capsys):
    assert main(["view", "--service", "/robot2/robot_task"]) == 1
    assert "no server of this machine has a live page of /robot2" in capsys.readouterr().err
