"""A tab that reads gets each event; one that does not keeps a bounded rest and is closed."""

import asyncio
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.observe.web import streams
from taskrpc.observe.web.streams import CallsEvent, Event, LiveStream, TabBuffer, TooManyTabs, chunk


class Connection:
    """Collects the bytes of a tab."""

    def __init__(self):
        self.written = []
        self.aborted = False

    def write(self, data):
        self.written.append(data)

    def abort(self):
        self.aborted = True

    @property
    def text(self):
        return b"".join(unchunked(data) for data in self.written)


class Source:
    """Notes when it must publish."""

    def __init__(self, stream):
        self.log = []
        self.stream = stream
        stream.source = self

    def begin(self):
        self.log.append("begin")
        self.stream.publish([state("tasks", 0)])

    def end(self):
        self.log.append("end")


def state(name, value):
    return Event(name, json.dumps(value).encode())


def calls(*numbers, skipped=0):
    return CallsEvent([b"%d" % number for number in numbers], skipped, b"{}")


def unchunked(data):
    size, _, rest = data.partition(b"\r\n")
    assert len(rest) == int(size, 16) + 2
    assert rest.endswith(b"\r\n")
    return rest[:-2]


def read(text):
    """The events in a stream, as (name, value)."""
    found = []
    for block in text.decode().split("\n\n"):
        if block.strip() and not block.startswith(":"):
            name, data = block.split("\n")
            found.append((name.removeprefix("event: "), json.loads(data.removeprefix("data: "))))
    return found


NAMES = st.sampled_from(["tasks", "robot", "path"])
EVENTS = st.builds(state, NAMES, st.integers()) | st.lists(
    st.integers(0, 999), max_size=streams.MAX_CALLS
).map(lambda numbers: calls(*numbers))


@given(st.lists(EVENTS))
def test_buffer_keeps_the_newest_state_of_each_name_and_the_newest_calls(events):
    buffer = TabBuffer()
    for event in events:
        buffer.put(event)
    found = dict(read(buffer.take()))
    last = {each.name: json.loads(each.json) for each in events if isinstance(each, Event)}
    batches = [each for each in events if isinstance(each, CallsEvent)]
    if batches:
        made = [int(call) for batch in batches for call in batch.calls]
        shown = found.pop("calls")
        assert shown["calls"] == made[-streams.MAX_CALLS :]
        assert shown["skipped"] == max(0, len(made) - streams.MAX_CALLS)
    assert found == last
    assert buffer.take() == b""


def test_states_in_a_buffer_are_in_the_order_of_their_last_change():
    buffer = TabBuffer()
    for event in (state("tasks", 1), state("robot", 1), state("tasks", 2)):
        buffer.put(event)
    assert read(buffer.take()) == [("robot", 1), ("tasks", 2)]


STEPS = st.lists(st.sampled_from(["pause", "resume"]) | EVENTS, max_size=30)


@given(STEPS)
def test_tab_that_reads_again_has_the_same_newest_states_as_one_that_always_read(steps):
    async def scenario():
        stream = LiveStream()
        connection, other = Connection(), Connection()
        tab, _ = stream.open(connection)
        always, _ = stream.open(other)
        for step in (*steps, "resume"):
            if step == "pause":
                tab.pause()
            elif step == "resume":
                tab.resume()
            else:
                before = len(connection.written)
                stream.publish([step])
                if tab.paused_at is not None:
                    assert len(connection.written) == before
        for each in (tab, always):
            each.close()
        assert dict(read(connection.text)).keys() == dict(read(other.text)).keys()
        for name, value in dict(read(other.text)).items():
            if name != "calls":
                assert dict(read(connection.text))[name] == value

    asyncio.run(scenario())


async def test_bytes_of_an_event_are_shared_by_all_tabs():
    stream = LiveStream()
    connections = [Connection() for _ in range(3)]
    for each in connections:
        stream.open(each)
    stream.publish([state("robot", 1), state("path", [])])
    assert len({id(each.written[-1]) for each in connections}) == 1
    assert read(connections[0].text) == [("robot", 1), ("path", [])]


async def test_source_works_only_while_tabs_are_open():
    stream = LiveStream()
    source = Source(stream)
    first, states = stream.open(Connection())
    assert read(states) == [("tasks", 0)]
    second, _ = stream.open(Connection())
    first.close()
    await asyncio.sleep(0)
    assert source.log == ["begin"]
    second.close()
    await asyncio.sleep(0)
    assert source.log == ["begin", "end"]
    assert not len(stream)


async def test_new_tab_gets_all_states_and_statistics_but_no_old_calls():
    stream = LiveStream()
    Source(stream)
    stream.open(Connection())
    stream.publish([state("robot", 1), calls(1)])
    stream.publish([state("robot", 2)])
    _, states = stream.open(Connection())
    no_calls = {"calls": [], "skipped": 0, "stats": {}}
    assert read(states) == [("tasks", 0), ("robot", 2), ("calls", no_calls)]


async def test_state_of_an_earlier_time_is_not_shown_to_the_next_first_tab():
    stream = LiveStream()
    Source(stream)
    tab, _ = stream.open(Connection())
    stream.publish([state("robot", "old")])
    tab.close()
    await asyncio.sleep(0)
    _, states = stream.open(Connection())
    assert read(states) == [("tasks", 0)]


async def test_quiet_stream_sends_a_sign_of_life():
    stream, connection = LiveStream(), Connection()
    stream.open(connection)
    await asyncio.sleep(2.5 * streams.SIGN_OF_LIFE)
    assert connection.text == b":\n\n" * 2


async def test_tab_that_does_not_read_is_closed_and_the_others_stay_open():
    stream, silent, reading = LiveStream(), Connection(), Connection()
    tab, _ = stream.open(silent)
    stream.open(reading)
    tab.pause()
    for number in range(1000):
        stream.publish([state("robot", number), calls(number)])
    assert silent.written == []
    await asyncio.sleep(streams.MAX_UNREAD_SECONDS - 1)
    assert not silent.aborted
    await asyncio.sleep(streams.SIGN_OF_LIFE + 1)
    assert silent.aborted
    assert not reading.aborted


async def test_one_tab_too_many_is_refused(monkeypatch):
    monkeypatch.setattr(streams, "MAX_TABS", 2)
    stream = LiveStream()
    tab, _ = stream.open(Connection())
    stream.open(Connection())
    with pytest.raises(TooManyTabs):
        stream.open(Connection())
    tab.close()
    await asyncio.sleep(0)
    stream.open(Connection())


def test_at_least_64_pages_may_be_open():
    assert streams.MAX_TABS >= 64


async def test_end_of_the_server_is_announced():
    stream, connection = LiveStream(), Connection()
    tab, _ = stream.open(connection)
    stream.close("the server is ending")
    assert read(connection.text) == [("ending", {"reason": "the server is ending"})]
    assert tab.closed.done()


def test_chunk_is_written_as_http_requires():
    assert chunk(b"x" * 26) == b"1a\r\n" + b"x" * 26 + b"\r\n"
