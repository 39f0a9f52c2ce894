"""The sequence diagram of a recorded run."""

from __future__ import annotations

import re

import msgspec
import pytest

from taskrpc.observe.recording.calls import CALLS_TOPIC, CallEnd
from taskrpc.observe.recording.mcap_file import Recording, RecordingWriter
from taskrpc.observe.recording.sequence import diagram
from tests.observe.recording.conftest import Run

ARROW = re.compile(r"    (p\d)(->>|-->>|--x)(p\d): (\d+\.\d{3}) s  (.+)")


async def test_diagram_shows_clients_server_and_robot(recorded_run):
    lines = diagram(Recording(recorded_run)).splitlines()
    assert lines[:4] == [
        "sequenceDiagram",
        "    participant p1 as /ada",
        "    participant p2 as /robot_task",
        "    participant p3 as the robot",
    ]
    assert all(ARROW.fullmatch(line) for line in lines[4:])
    text = "\n".join(lines)
    assert "p1->>p2: 0.000 s  task_type=move target=warehouse priority=5" in text
    assert re.search(r"p2->>p3: \d\.\d+ s  task 3: report 3,4", text)
    assert re.search(r"p3-->>p2: \d+\.\d+ s  task 3 SUCCEEDED", text)
    assert re.search(r"p1->>p2: \d+\.\d+ s  cancel task_id=4", text)


async def test_arrows_are_in_order_of_time(recorded_run):
    lines = diagram(Recording(recorded_run)).splitlines()
    times = [float(found[4]) for line in lines if (found := ARROW.fullmatch(line))]
    assert times == sorted(times)


async def test_limit_says_how_many_calls_are_left_out(recorded_run):
    whole = diagram(Recording(recorded_run))
    calls = len(re.findall(r"p1->>p2", whole))
    cut = diagram(Recording(recorded_run), limit=3)
    assert len(re.findall(r"p1->>p2", cut)) == 3
    assert f"{calls - 3} more calls are not shown" in cut


async def test_text_of_a_client_cannot_change_the_diagram(tmp_path):
    async with Run(tmp_path / "a.mcap") as run:
        await run.submit("move", "a; b\nparticipant <b>#quot;", 5)
    text = diagram(Recording(tmp_path / "a.mcap"))
    assert "target=a#59; b participant #lt;b#gt;#35;quot#59;" in text


def test_names_from_a_crafted_file_stay_texts(tmp_path):
    writer = RecordingWriter(tmp_path / "a.mcap")
    topic = writer.add_json_topic(CALLS_TOPIC)
    name = "a%%{init: {'theme': 'forest'}}%%$$x$$\x1b[31m\u2028\u202e" + "z" * 1000
    call = CallEnd(number=1, service="/s\nb->>c: x", client=name, began=1.0, ms=2.0, code="<b>")
    writer.write(topic, msgspec.json.encode(call), 10**9)
    writer.close()
    lines = diagram(Recording(writer.path)).splitlines()
    client = "a#37;#37;{init: {'theme': 'forest'}}#37;#37;#36;#36;x#36;#36; [31m  "
    assert lines[1].startswith(f"    participant p1 as {client}zzz")
    assert len(lines[1]) < 300
    assert lines[2] == "    participant p2 as /s b-#gt;#gt;c: x"
    assert lines[3:] == [
        "    p1->>p2: 0.000 s  request",
        "    p2--xp1: 0.002 s  #lt;b#gt; (2 ms)",
    ]


async def test_error_is_drawn_with_a_cross(tmp_path):
    async with Run(tmp_path / "a.mcap") as run:
        run.server.dismiss_watchers()
        await run.server.close()
        with pytest.raises(Exception, match="the task server is ending"):
            await run.submit("move", "dock", 5)
    assert re.search(r"p2--xp1: \d\.\d+ s  UNAVAILABLE \(", diagram(Recording(tmp_path / "a.mcap")))


def test_recording_without_calls_has_no_diagram(tmp_path):
    RecordingWriter(tmp_path / "a.mcap").close()
    assert diagram(Recording(tmp_path / "a.mcap")) == ""
