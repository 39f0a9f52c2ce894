"""The picture fits every terminal, and says in signs what it says in colours."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.cli.observe.top.picture import (
    ASCII,
    UNICODE,
    Role,
    fitted,
    per_second,
    picture,
    seconds,
    shares,
    text_of,
    width_of,
)
from taskrpc.observe.top.model import NodeRow, Pose, ServiceRow, TaskRow, TaskServerRow, View


def service(name, rate=0.0, *, p50=None, p99=None, errors=0, now=0, running=0, waiting=0):
    codes = {0: 5} if rate else {}
    nodes = ("/task_server",)
    return ServiceRow(name, nodes, rate, p50, p99, errors, now, codes, running, waiting)


def node(name, *, program="client.py", problem="", calls_in=None, calls_out=0.0, cpu=None):
    return NodeRow(name, program, 4711, cpu, calls_in, calls_out, problem)


TASKS = (
    TaskRow(7, "scan central", 10, "RUNNING", 0.62, 4.0, "/ada"),
    TaskRow(1, "move warehouse", 8, "QUEUED", 0.0, 10.1, "/ben"),
)
SERVER = TaskServerRow("/robot_task", False, 1, TASKS, Pose(2.14, 3.4, math.pi / 2))
BUSY = View(
    1_700_000_000.0,
    0,
    "",
    5.0,
    3,
    (
        service("/add_two_ints", 231.4, p50=0.00011, p99=0.0013, errors=2, now=1, waiting=3),
        service("/robot_task", 0.2, p50=0.0021, p99=0.003),
        *(service(f"/robot_task/{verb}") for verb in "cancel drop health list show".split()),
    ),
    (
        node("/frozen", problem="it did not respond in time"),
        node("/ada", calls_out=231.4),
        node("/task_server", program="taskrpc-server", calls_in=231.6, cpu=0.02),
    ),
    (SERVER,),
)
NOTHING = View(1_700_000_000.0, 0, "", 0.0, 0, (), (), ())

NARROW = """\
{title}
232 calls/s   ✕ 2 errors   ! 1 problem
SERVICE           CALLS/S     P99 ERRORS
/add_two_ints         231  1.3 ms    ✕ 2
… 6 more
/robot_task  ▶ working  1 queued
▶  7 scan central        10  62%   4.0 s
   1 move warehouse       8       10.1 s
NODE                   IN/S  OUT/S
! /frozen: it did not respond in time
… 2 more
q ends"""

MIDDLE = """\
{title}
232 calls/s   ✕ 2 errors   ! 1 problem   3 open   3 programs   last 5 s

SERVICE               CALLS/S      P50      P99  ERRORS   RUN    WAIT
/add_two_ints             231  0.11 ms   1.3 ms     ✕ 2     0     ! 3
/robot_task               0.2   2.1 ms   3.0 ms       0     0       0
/robot_task/cancel          0        -        -       0     0       0
/robot_task/drop            0        -        -       0     0       0
/robot_task/health          0        -        -       0     0       0
/robot_task/list            0        -        -       0     0       0
/robot_task/show            0        -        -       0     0       0

/robot_task  ▶ working  1 queued  robot at 2.1, 3.4 m, heading 90°
▶    7  scan central               prio 10     62%  in   4.0 s  /ada
     1  move warehouse             prio  8  queued  in  10.1 s  /ben

NODE                    IN/S   OUT/S    CPU      PID  PROGRAM
! /frozen: it did not respond in time
/ada                       -     231      -     4711  client.py
/task_server             232       0    2 %     4711  taskrpc-server



q ends"""


def text(view, columns=0, rows=0, signs=UNICODE):
    return [text_of(line) for line in picture(view, columns, rows, signs)]


def without_title(lines):
    assert lines[0].startswith("taskrpc top")
    return "\n".join(["{title}", *lines[1:]])


def test_a_terminal_of_40_columns_shows_fewer_values():
    assert without_title(text(BUSY, 40, 12)) == NARROW


def test_a_terminal_of_80_columns_shows_all_values():
    assert without_title(text(BUSY, 80, 24)) == MIDDLE


def test_a_wide_terminal_keeps_numbers_near_their_names_and_adds_the_node():
    lines = text(BUSY, 200, 60)
    assert lines[4].split() == "/add_two_ints 231 0.11 ms 1.3 ms ✕ 2 0 ! 3 /task_server".split()
    assert width_of(lines[4]) < 100


@given(st.integers(40, 200), st.integers(12, 60))
def test_no_line_is_longer_than_the_terminal_and_no_picture_higher(columns, rows):
    lines = text(BUSY, columns, rows)
    assert len(lines) == rows
    assert max(map(width_of, lines)) <= columns
    assert lines[-1].startswith("q ends")
    assert any("add_two_ints" in line for line in lines)
    assert any("working" in line for line in lines)
    assert any("/frozen" in line for line in lines)


@given(st.integers(1, 60), st.integers(1, 20))
def test_a_tiny_terminal_gets_a_picture_too(columns, rows):
    assert len(text(BUSY, columns, rows)) == rows


def test_without_a_width_nothing_is_cut():
    long = "/a" * 60
    view = View(0.0, 0, "", 5.0, 1, (service(long, 1.0),), (node(long),), ())
    lines = text(view)
    assert sum(long in line for line in lines) == 2
    assert "q ends" not in lines


def test_long_names_lose_their_beginning():
    assert fitted("/robot_task/reprioritise", 14) == "…/reprioritise"
    assert fitted("/add", 6) == "/add  "


def test_wide_characters_take_two_columns():
    assert width_of("移動 dock") == 9
    assert width_of("e\N{COMBINING ACUTE ACCENT}") == 1
    assert width_of(fitted("移動移動移動", 6)) == 6


def test_a_task_with_wide_characters_stays_in_its_column():
    task = TaskRow(
        1, "move 移動移動移動移動移動移動移動移動移動移動移動", 5, "QUEUED", 0.0, 3.0, "/ada"
    )
    view = View(0.0, 0, "", 5.0, 1, (), (node("/a"),), (TaskServerRow("/t", False, 1, (task,)),))
    for columns in (40, 80, 120):
        line = next(each for each in text(view, columns, 24) if "移動" in each)
        assert width_of(line) <= columns


def test_an_ascii_terminal_gets_ascii_signs():
    shown = "\n".join(text(BUSY, 80, 24, ASCII)).replace("°", "")
    assert shown.isascii()
    assert "x 2 errors" in shown
    assert "> working" in shown


def test_errors_and_problems_have_a_sign_beside_their_colour():
    for line in picture(BUSY, 80, 24):
        for span in line:
            if span.role is Role.ERROR:
                assert UNICODE.error in span.text
            if span.role is Role.WARNING:
                assert UNICODE.warning in span.text


@pytest.mark.parametrize(
    ("seconds", "services", "shown"),
    [
        (0.3, BUSY.services, "  last 0.3 s"),
        (4.98, BUSY.services, "  last 5 s"),
        (0.0, BUSY.services, "  measuring"),
        (0.0, (), " 3 programs"),
    ],
)
def test_totals_show_the_seconds_over_which_they_are_measured(seconds, services, shown):
    view = msgspec.structs.replace(BUSY, seconds=seconds, services=services)
    assert text(view, 100, 24)[1].endswith(shown)


def test_title_names_the_server_if_all_programs_run_on_other_machines():
    nodes = [msgspec.structs.replace(row, pid=0, program="lab:7450") for row in BUSY.nodes]
    view = msgspec.structs.replace(BUSY, nodes=tuple(nodes))
    assert text(view, 100, 24)[0].startswith("taskrpc top · lab:7450 ")
    mixed = msgspec.structs.replace(BUSY, nodes=(*nodes, BUSY.nodes[0]))
    assert text(mixed, 100, 24)[0].startswith("taskrpc top · this machine ")


def test_errors_before_the_window_are_not_red():
    view = View(0.0, 0, "", 5.0, 1, (service("/add", 1.0, errors=2),), (node("/a"),), ())
    roles = {span.role for line in picture(view, 80, 24) for span in line}
    assert Role.ERROR not in roles


@pytest.mark.parametrize("columns", [40, 80])
def test_without_programs_the_picture_says_how_to_start_one(columns):
    shown = " ".join(" ".join(text(NOTHING, columns, 12)).split())
    assert "No taskrpc program runs here. Start one: taskrpc-server" in shown


def test_without_programs_the_picture_names_the_domain_that_has_some():
    view = View(0.0, 7, "", 0.0, 0, (), (), (), (3, 5))
    shown = " ".join(text(view, 60, 12))
    assert "No taskrpc program runs in domain 7." in shown
    assert "Programs run in domain 3: set ROS_DOMAIN_ID=3." in shown


def test_a_paused_queue_has_a_sign_and_a_word():
    halted = TaskRow(7, "scan central", 10, "PAUSED", 0.62, 4.0, "/ada")
    server = TaskServerRow("/robot_task", True, 1, (halted,))
    view = View(0.0, 0, "", 5.0, 1, (), (node("/a"),), (server,))
    lines = text(view, 80, 24)
    assert "/robot_task  ‖ paused  1 queued" in lines
    assert any(line.startswith("‖    7  scan central") for line in lines)


def test_a_task_server_that_cannot_be_read_says_why():
    server = TaskServerRow("/robot_task", problem="the account ada needs the role observe")
    view = View(0.0, 0, "", 5.0, 1, (), (node("/a"),), (server,))
    assert "/robot_task  ! the account ada needs the role observe" in text(view, 80, 24)


@given(st.integers(-3, 50), st.lists(st.integers(0, 20), max_size=6))
def test_rows_are_divided_fairly(room, wants):
    given_rows = shares(room, wants)
    assert sum(given_rows) == min(max(room, 0), sum(wants))
    assert all(had <= want for had, want in zip(given_rows, wants, strict=True))
    cut = [had for had, want in zip(given_rows, wants, strict=True) if had < want]
    if cut:
        assert max(given_rows) - min(cut) <= 1


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "-"),
        (0.0000312, "0.03 ms"),
        (0.00123, "1.2 ms"),
        (0.0999, "100 ms"),
        (0.9996, "1.0 s"),
        (20.3, "20 s"),
        (90_000.0, "25 h"),
    ],
)
def test_durations_have_a_unit(value, shown):
    assert seconds(value) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "-"),
        (0.0, "0"),
        (0.001, "0.01"),
        (0.04, "0.04"),
        (0.2, "0.2"),
        (9.94, "9.9"),
        (231.4, "231"),
        (123_456.0, "123k"),
    ],
)
def test_rates_are_short(value, shown):
    assert per_second(value) == shown


@given(st.floats(0, 1e6))
def test_values_fit_their_columns(value):
    assert len(seconds(value)) <= 7
    assert len(per_second(value)) <= 6
