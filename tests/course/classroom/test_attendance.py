"""The last call of each account is stored: at once for a new account, otherwise periodically."""

from types import SimpleNamespace

from taskrpc.course.classroom.attendance import WRITE_EVERY, Attendance, last_calls


def test_caller_is_recorded(tmp_path):
    path, clock = tmp_path / "attendance.json", SimpleNamespace(now=100.0)
    attendance = Attendance(path, lambda: clock.now)
    attendance.call_began(SimpleNamespace(principal="ada"))
    assert last_calls(path) == {"ada": 100.0}
    clock.now += WRITE_EVERY / 2
    attendance.call_began(SimpleNamespace(principal="ada"))
    assert last_calls(path) == {"ada": 100.0}
    attendance.call_began(SimpleNamespace(principal="bob"))
    assert last_calls(path) == {"ada": clock.now, "bob": clock.now}
    clock.now += WRITE_EVERY
    attendance.call_began(SimpleNamespace(principal="ada"))
    assert last_calls(path)["ada"] == clock.now


def test_last_calls_are_written_at_the_end_and_read_by_the_next_server(tmp_path):
    path, clock = tmp_path / "attendance.json", SimpleNamespace(now=100.0)
    attendance = Attendance(path, lambda: clock.now)
    for clock.now in (100.0, 101.0):
        attendance.call_began(SimpleNamespace(principal="ada"))
    attendance.node_ended(None)
    assert last_calls(path) == {"ada": 101.0}
    Attendance(path, lambda: 200.0).call_began(SimpleNamespace(principal="bob"))
    assert last_calls(path) == {"ada": 101.0, "bob": 200.0}


def test_programs_of_the_lecturer_are_not_recorded(tmp_path):
    path = tmp_path / "attendance.json"
    attendance = Attendance(path)
    attendance.call_began(SimpleNamespace(principal=""))
    attendance.node_ended(None)
    assert not path.exists()


def test_next_group_begins_without_calls(tmp_path):
    file = tmp_path / "attendance.json"
    attendance = Attendance(file, lambda: 5.0)
    attendance.call_began(type("Call", (), {"principal": "ada"}))
    attendance.clear()
    assert last_calls(file) == {}
    attendance.node_ended(None)
    assert last_calls(file) == {}
