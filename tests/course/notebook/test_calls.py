from types import SimpleNamespace

from taskrpc.course.notebook.calls import MOST_CALLS, CallList
from taskrpc.errors import Code


def served(calls, service, caller, code=Code.OK):
    call = SimpleNamespace(service=service, caller=caller)
    calls.call_began(call)
    calls.call_ended(call, code, 0.0021)


def test_newest_call_is_first():
    calls = CallList(wall_clock=lambda: 5.0)
    served(calls, "/add", "/ana")
    calls.request_ended("/far", Code.DEADLINE_EXCEEDED, 2.0)
    far, add = calls.newest()
    assert (far.caller, far.service, far.result, far.ms) == ("", "/far", "DEADLINE_EXCEEDED", 2000)
    assert (add.caller, add.service, add.result, add.ms, add.at) == ("/ana", "/add", "OK", 2.1, 5)


def test_call_between_two_nodes_of_the_notebook_is_kept_once():
    calls = CallList()
    served(calls, "/add", "/ana")
    calls.request_ended("/add", Code.OK, 0.003)
    assert [each.caller for each in calls.newest()] == ["/ana"]


def test_calls_of_tools_are_not_shown():
    calls = CallList()
    served(calls, "/robot_task/list", "/_taskrpc_view_1")
    calls.request_ended("/ana/_hidden", Code.OK, 0.1)
    assert calls.newest() == []


def test_old_calls_are_forgotten():
    calls = CallList()
    for number in range(3 * MOST_CALLS):
        served(calls, "/add", f"/n{number}")
    assert [each.caller for each in calls.newest()][:1] == [f"/n{3 * MOST_CALLS - 1}"]
    assert len(calls.newest()) == MOST_CALLS
