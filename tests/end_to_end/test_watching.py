"""Monitoring of a running `taskrpc-server`: its log, its pages, and its refusals."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from taskrpc.cli.call import main as call
from tests.observe.metrics.exposition import read, values

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

PATIENCE = 60
SERVER = [sys.executable, "-m", "taskrpc.cli.robot.server.command_line", "--db", ":memory:"]


class Watched:
    """A server process and the lines that it has written."""

    def __init__(self, *argv, **options):
        self.process = subprocess.Popen(
            [*SERVER, *argv],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            **options,
        )
        self.lines = []

    def until(self, text):
        """Return the lines up to the first line with this text, and that line."""
        for line in self.process.stderr:
            self.lines.append(line.rstrip("\n"))
            if text in line:
                return self.lines[-1]
        raise AssertionError(self.lines)

    def end(self):
        self.process.terminate()
        self.lines += self.process.communicate(timeout=PATIENCE)[1].splitlines()
        return self.process.returncode


@pytest.fixture
def start():
    with contextlib.ExitStack() as stack:

        def start(*argv, **options):
            made = Watched(*argv, **options)
            stack.callback(made.process.communicate)
            stack.callback(made.process.kill)
            return made

        yield start


def fetch(url):
    try:
        with urllib.request.urlopen(url, timeout=PATIENCE) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def refused(*argv, **options):
    done = subprocess.run(
        [*SERVER, *argv], capture_output=True, text=True, timeout=PATIENCE, check=False, **options
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr


@pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals")
def test_json_log_lines_are_json_and_link_tasks_with_calls(start, capsys):
    server = start("--log-format", "json", "--log-level", "debug")
    server.until("taskrpc-server ready: ")
    assert call(["/robot_task", "task_type=move", "target=dock", "priority=5"]) == 0
    server.until("completed")
    assert server.end() == 0
    lines = [json.loads(line) for line in server.lines]
    (queued,) = [line for line in lines if "queued: move" in line["message"]]
    assert (queued["task"], queued["service"]) == (1, "/robot_task")
    same = [line["message"] for line in lines if line.get("call") == queued["call"]]
    assert same[0].endswith("began")
    assert "ended: OK after" in same[-1]


@pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals")
def test_health_and_metrics_are_served_from_start_to_exit(start, capsys):
    server = start("--web", "127.0.0.1:0")
    url = server.until("/health and /metrics at ").rpartition(" ")[2]
    server.until("taskrpc-server ready: ")
    assert fetch(f"{url}/health") == (
        200,
        '{"ready": true, "message": "ready: no tasks in the queue"}\n',
    )
    assert call(["/robot_task", "task_type=move", "target=dock", "priority=5"]) == 0
    server.until("completed")
    status, text = fetch(f"{url}/metrics")
    assert status == 200
    assert values(text, "taskrpc_calls_total") == {"OK//robot_task": 1}
    assert values(text, "taskrpc_tasks")["SUCCEEDED"] == 1
    assert values(text, "taskrpc_store_seconds")["_count"] >= 3
    assert read(text)["taskrpc_loop_late_seconds"][0] == "histogram"
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(PATIENCE) == 0


def test_pages_outside_this_machine_need_tls_and_a_token():
    code, said = refused("--web", "0.0.0.0:0")
    assert code == 1
    assert "cannot serve pages at 0.0.0.0 without a certificate and a token" in said


def test_missing_aiohttp_error_names_the_install_command(tmp_path):
    (tmp_path / "aiohttp.py").write_text("raise ModuleNotFoundError(name='aiohttp')\n")
    path = os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])
    code, said = refused("--web", "127.0.0.1:0", env={**os.environ, "PYTHONPATH": path})
    assert (code, said) == (1, "--web needs aiohttp: pip install aiohttp\n")


def test_server_without_pages_imports_neither_metrics_nor_aiohttp(start):
    server = start(env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"})
    server.until("taskrpc-server ready: ")
    imported = {line.rpartition("|")[2].strip() for line in server.lines}
    assert "taskrpc.robot.tasks.manager" in imported
    assert not {"aiohttp", "json", "taskrpc.observe.metrics", "taskrpc.observe.web"} & imported
