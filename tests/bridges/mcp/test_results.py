"""What an agent is told about a call: the response, or the error and what to do."""

import json

import pytest

import srvgen
from srvgen import FieldError
from taskrpc import errors
from taskrpc.bridges.mcp.permissions import Refused
from taskrpc.bridges.mcp.results import UnknownTool, dry_run, failure, response

TRIGGER = srvgen.load("std_srvs/srv/Trigger")
POINT = srvgen.load("geometry_msgs/msg/Point")


def test_response_is_the_same_as_text_and_as_json():
    found = response(TRIGGER.Response(success=True, message="done"))
    assert json.loads(found.text) == found.json == {"success": True, "message": "done"}
    assert not found.is_error


def test_nan_is_null():
    assert response(POINT(x=float("nan"), y=float("inf"))).json == {"x": None, "y": None, "z": 0.0}


@pytest.mark.parametrize(
    ("error", "request_id", "name", "executed", "advice"),
    [
        (FieldError("a.b", "expected int8"), "", "InvalidRequest", "no", "Correct the arguments"),
        (errors.InvalidRequest("a", "no"), "", "InvalidRequest", "no", "Correct the arguments"),
        (errors.ServiceUnavailable("x"), "", "ServiceUnavailable", "no", "List the tools again"),
        (errors.TypeMismatch("x"), "", "TypeMismatch", "no", "List the tools again"),
        (UnknownTool("x"), "", "UnknownTool", "no", "List the tools again"),
        (errors.ServerBusy("x", retry_after=2), "", "ServerBusy", "no", "Try again in 2.0 s"),
        (errors.ServerBusy("x"), "", "ServerBusy", "no", "The call has not run"),
        (errors.OutcomeUnknown("x"), "", "OutcomeUnknown", "unknown", "Find out whether"),
        (errors.OutcomeUnknown("x"), "s-1", "OutcomeUnknown", "unknown", '_request_id "s-1": it'),
        (errors.DeadlineExceeded("x"), "s-1", "DeadlineExceeded", "unknown", "it runs once"),
        (errors.HandlerFailed("INTERNAL", "x"), "", "HandlerFailed", "yes", "The call has run"),
        (errors.RequestIdReused("x"), "a", "RequestIdReused", "no", "a new _request_id"),
        (Refused("x", line=3), "", "Refused", "no", "Do not repeat the call"),
        (Refused("x", retry_after=1.5), "", "Refused", "no", "Try again in 1.5 s"),
        (srvgen.DefinitionError("x"), "", "DefinitionError", "no", "The call has not run"),
    ],
)
def test_error_says_whether_the_call_ran_and_what_to_do(error, request_id, name, executed, advice):
    found = failure(error, request_id)
    assert found.is_error
    assert (found.json["error"], found.json["executed"]) == (name, executed)
    assert advice in found.json["advice"]
    assert found.text == f"{name}: {found.json['message']}\n{found.json['advice']}"


def test_error_names_its_field():
    assert failure(FieldError("a.b", "expected int8, got 9")).json["field"] == "a.b"


def test_error_has_the_time_to_wait():
    assert failure(errors.ServerBusy("x", retry_after=2.5)).json["retry_after"] == 2.5


def test_goal_that_failed_has_its_result():
    message = POINT(x=1.0)
    found = failure(errors.GoalAborted("ABORTED", "stuck", message))
    assert found.json["result"] == {"x": 1.0, "y": 0.0, "z": 0.0}


def test_error_of_the_bridge_itself_shows_nothing_of_it():
    found = failure(RuntimeError("/home/robot/secret"))
    assert "secret" not in found.text
    assert found.json["executed"] == "unknown"


def test_dry_run_shows_the_request_with_its_defaults():
    found = dry_run("/point", POINT(x=1.0))
    assert found.is_error
    assert (found.json["error"], found.json["executed"]) == ("DryRun", "no")
    assert found.json["request"] == {"x": 1.0, "y": 0.0, "z": 0.0}
