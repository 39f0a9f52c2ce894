"""`taskrpc view FILE` shows a recording, says what is wrong with it, and ends with a signal."""

from __future__ import annotations

import argparse
import contextlib
import gzip
import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest

from taskrpc.cli.main import main
from taskrpc.cli.observe.view import recording as view_recording
from taskrpc.core.security.installing import install_command
from taskrpc.observe.recording.mcap_file import Recording, RecordingWriter
from taskrpc.observe.recording.timeline import Timeline
from tests.observe.recording.conftest import record_run
from tests.observe.web.test_streams import read as read_events


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    record_run(path)
    return path


@pytest.fixture
def recorded_run(recorded, tmp_path):
    return Path(shutil.copy(recorded, tmp_path))


POSIX = pytest.mark.skipif(os.name == "nt", reason="sends POSIX signals")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "cannot read"),
        ("", "is empty; expected an MCAP file"),
        ("hello", "is not a recording: expected an MCAP file"),
        ("#ROSBAG V2.0", "it is a bag of ROS 1"),
        ("SQLite format 3", "it is an SQLite file"),
    ],
)
def test_file_that_is_no_recording_is_one_line(tmp_path, capsys, content, problem):
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_text(content)
    assert main(["view", str(path)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert problem in err
    assert str(path) in err


def test_folder_without_a_recording_is_one_line(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 1
    assert capsys.readouterr().err == (f"expected a folder with .mcap files, {tmp_path} has none\n")


def test_recording_without_a_message_is_one_line(tmp_path, capsys):
    RecordingWriter(tmp_path / "x.mcap").close()
    assert main(["view", str(tmp_path / "x.mcap")]) == 1
    assert capsys.readouterr().err == f"{tmp_path / 'x.mcap'} has no message\n"


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("missing", "problem"),
    [
        ("aiohttp", "taskrpc view needs aiohttp: pip install aiohttp\n"),
        ("mcap", f"recordings need mcap: {install_command('record', 'mcap')}\n"),
    ],
)
def test_missing_extra_is_one_line_with_its_command(tmp_path, missing, problem):
    code = f"import sys; sys.modules[{missing!r}] = None; from taskrpc.__main__ import main"
    command = [sys.executable, "-c", f"{code}; sys.exit(main())", "view", "x.mcap"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", problem)


@contextlib.contextmanager
def viewing(path, *options):
    """The command in a process, and the address of its page."""
    command = [sys.executable, "-m", "taskrpc", "view", str(path), "--no-browser", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            link = process.stdout.readline().decode()
            assert link.startswith("read-only: http://127.0.0.1:"), process.stderr.read()
            yield process, link.split("/")[2]
        finally:
            process.kill()


def fetch(place, path, method="GET", **headers):
    connection = http.client.HTTPConnection(place, timeout=60)
    try:
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, headers=sent)
        response = connection.getresponse()
        return response.status, response.headers, response.read()
    finally:
        connection.close()


def hello(place):
    """The first event of the page's stream, which stays open."""
    connection = http.client.HTTPConnection(place, timeout=60)
    try:
        connection.request("GET", "/live")
        response = connection.getresponse()
        text = response.readline() + response.readline() + response.readline()
        [(name, data)] = read_events(text)
        assert name == "hello"
        return data
    finally:
        connection.close()


@pytest.mark.end_to_end
@POSIX
@pytest.mark.real_time
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_recording_is_served_until_a_signal(recorded_run, number, status):
    timeline = Timeline(Recording(recorded_run))
    with viewing(recorded_run) as (process, place):
        assert hello(place) == json.loads(json.dumps(timeline.hello.data))
        plain = fetch(place, "/recording")
        packed = fetch(place, "/recording", Accept_Encoding="gzip, br")
        page = fetch(place, "/")
        changed = fetch(place, "/control/stop", "POST")
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == status
    assert said == b"Ctrl-C ends the command\n"
    assert plain[2] == b"".join(timeline.lines()) == gzip.decompress(packed[2])
    assert packed[1]["Content-Encoding"] == "gzip"
    assert len(packed[2]) < len(plain[2]) / 5
    assert page[0] == 200
    assert "default-src 'none'" in page[1]["Content-Security-Policy"]
    assert changed[0] == 401


def test_folder_of_a_bag_of_rosbag2_is_shown_as_one_recording(recorded_run, tmp_path, monkeypatch):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag/metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    recorded_run.rename(tmp_path / "bag/bag_0.mcap")
    timeline = view_recording._timeline(tmp_path / "bag")
    assert timeline.hello.data["recording"]["name"] == "bag"
    assert timeline.problem == ""
    monkeypatch.chdir(tmp_path / "bag")
    assert view_recording._timeline(Path()).name == "bag"


@POSIX
@pytest.mark.real_time
def test_unfinished_recording_is_shown_with_its_problem(recorded_run):
    data = recorded_run.read_bytes()
    recorded_run.write_bytes(data[: len(data) // 2])
    with viewing(recorded_run) as (process, place):
        problem = hello(place)["recording"]["problem"]
        process.terminate()
        _, said = process.communicate(timeout=60)
    assert problem.startswith("run.mcap is not finished")
    assert said.decode().splitlines()[0] == f"WARNING: {problem}"


def test_difference_between_recording_and_replay_is_said_in_words(recorded_run):
    data = recorded_run.read_bytes()
    before = b'"pose":{"x":3.0,'
    assert before in data
    recorded_run.write_bytes(data.replace(before, b'"pose":{"x":3.5,'))
    problem = view_recording._timeline(recorded_run).problem
    assert problem.startswith("the decisions differ from their replay")
    assert "in the recording and is" in problem


def test_large_recording_is_not_replayed(recorded_run, monkeypatch):
    monkeypatch.setattr(view_recording, "_MOST_REPLAYED", 100)
    monkeypatch.setattr(view_recording, "replay", lambda recording: 1 / 0)
    assert view_recording._timeline(recorded_run).problem == ""


@pytest.mark.parametrize(("projector", "query"), [(False, ""), (True, "?projector")])
def test_browser_gets_a_link_without_a_token(monkeypatch, capsys, projector, query):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    options = argparse.Namespace(no_browser=False, projector=projector)
    view_recording._show("http://127.0.0.1:8642", options)
    assert opened == [f"http://127.0.0.1:8642/{query}"]
    assert capsys.readouterr() == ("", "the recording is at http://127.0.0.1:8642/\n")


def test_links_are_printed_where_no_browser_can_be_opened(monkeypatch, capsys):
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    options = argparse.Namespace(no_browser=False, projector=False)
    view_recording._show("http://127.0.0.1:8642", options)
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "read-only: http://127.0.0.1:8642/",
        "projector: http://127.0.0.1:8642/?projector",
    ]
    assert err == "found no browser; open one of these links yourself:\n"
