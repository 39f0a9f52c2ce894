"""The story of a failing run is for readers."""

import msgspec

from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.trace import Event
from taskrpc.simulation.search.protocol import Explained
from taskrpc.simulation.search.story import lines_of, story, summary

FOUND = Explained(
    seed=7,
    kind="every_order_once",
    text="assert 2 == 1",
    faults=["lose response 1 of /pick"],
    groups=[],
    in_order=True,
    hash="abc",
    events=[
        Event(0.25, "robot", "start", "starts"),
        Event(0.5, "student", "call", "/pick", "client.py:2"),
        Event(0.5, "robot", "fault", "lose response 1 of /pick"),
        Event(1.5, "student", "error", "/pick DEADLINE_EXCEEDED", "client.py:9"),
    ],
    waits=["student waits at client.py:2 for the response of /pick"],
    failed_at=1.5,
)
LINES = {"client.py": ["import taskrpc", "    response = call()"]}


def changed(**values):
    return story(msgspec.structs.replace(FOUND, **values), LINES)


def test_story_has_the_failure_the_faults_the_events_with_lines_and_the_waits():
    assert story(FOUND, LINES).splitlines() == [
        "FAILED: every_order_once",
        "  assert 2 == 1",
        "",
        "Seed 7 fails with response 1 of /pick lost.",
        "",
        "   0.250 s  robot    starts",
        "   0.500 s  student  calls /pick    client.py:2  response = call()",
        "   0.500 s  robot    FAULT: response 1 of /pick lost",
        "   1.500 s  student  call fails: /pick DEADLINE_EXCEEDED    client.py:9  ",
        "",
        "At the end:",
        "  student waits at client.py:2 for the response of /pick",
    ]


def test_failure_without_faults_says_so():
    assert "Seed 7 fails with no fault at all." in changed(faults=[])


def test_what_a_failure_needs_besides_faults_is_named():
    text = changed(faults=["kill robot at its event 3"], groups=["delays"], in_order=False)
    assert (
        "fails with robot killed and these delays of the network and an unlucky order of the"
        " threads." in text
    )


def test_each_kind_of_fault_has_words():
    names = [
        "lose request 2 of /pick",
        "duplicate request 1 of /pick",
        "delay request 1 of /pick",
        "refuse request 1 of /pick",
        "kill robot at its event 2",
        "part robot from student",
        "slow robot",
        "wrong clock robot",
    ]
    text = changed(faults=names)
    assert "request 2 of /pick lost and request 1 of /pick arriving twice" in text
    assert "robot and student out of each other's reach and a slow robot and a wrong clock" in text


def prints(count):
    return [Event(number, "robot", "print", f"line {number}") for number in range(count)]


def test_long_story_has_gaps_unless_everything_is_wanted():
    found = msgspec.structs.replace(FOUND, events=prints(100), failed_at=99.0)
    short, long = story(found, LINES), story(found, LINES, everything=True)
    assert "… 60 more events (--verbose shows them)" in short
    assert "line 9\n" in short
    assert "line 50\n" not in short
    assert "line 50\n" in long


def test_long_story_shows_what_lies_around_each_fault_and_the_failure():
    events = prints(300)
    events[100] = Event(100, "robot", "fault", "lose response 1 of /pick")
    events[200] = Event(200, "robot", "crash", "is killed")
    found = msgspec.structs.replace(FOUND, events=events, failed_at=250.5)
    lines = story(found, LINES).splitlines()[5:]
    shown = [float(each.split()[0]) for each in lines if " s  robot" in each]
    assert {0, 96, 100, 104, 196, 200, 204, 247, 250, 253, 299} <= set(shown)
    assert shown == sorted(shown)
    assert len(shown) == 40
    assert sum("more events" in each for each in lines) == 4


def test_story_of_more_faults_than_can_be_shown_is_short_too():
    events = [Event(number, "robot", "fault", "slow robot") for number in range(9000)]
    found = msgspec.structs.replace(FOUND, events=events, failed_at=8000.0)
    assert len(story(found, LINES).splitlines()) < 60


def test_equal_messages_are_told_once_until_something_else_happens():
    def message(time, topic):
        return Event(time, "robot", "message", topic, "robot.py:1")

    events = [message(0.1 * number, f"/{'ab'[number % 2]}") for number in range(7)]
    events += [Event(1.0, "robot", "print", "ready"), message(1.1, "/a"), message(1.2, "/a")]
    found = msgspec.structs.replace(FOUND, events=events, failed_at=1.2)
    told = [each.split("robot.py")[0].split() for each in story(found, {}).splitlines()[5:10]]
    assert [" ".join(words[3:]) for words in told[:4]] == [
        "publishes on /a, 4 times until the next other event",
        "publishes on /b, 3 times until the next other event",
        "prints: ready",
        "publishes on /a, 2 times until the next other event",
    ]
    assert story(found, {}, everything=True).count("publishes") == 9


def test_lines_are_those_of_the_files_in_the_folder(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "client.py").write_text("one\ntwo\n")
    assert lines_of(FOUND, tmp_path) == {"client.py": ["one", "two"]}


def test_summary_says_what_was_reached_and_what_was_not():
    coverage = Coverage(
        runs=100,
        seconds=600.0,
        calls={"/pick": 9, "/place": 1},
        unanswered={"/pick": 2},
        messages={"/map": 1, "/scan": 5},
        unheard={"/scan": 2},
        offered={"/pick": 9, "/stop": 9},
        faults={"lose request": 3, "kill": 1},
    )
    text = summary(coverage, 40, 2.0)
    assert text.startswith("100 runs in 2.0 s (50 a second; 600 s of virtual time), 40 different")
    assert "Calls: /pick 9 (2 without a response), /place 1." in text
    assert "Messages: /map 1, /scan 5 (2 without a subscription)." in text
    assert "Faults: kill 1, lose request 3." in text
    assert text.endswith("Not reached: nobody called /stop.")
