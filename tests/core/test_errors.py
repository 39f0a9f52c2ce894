"""The tree in the module's docstring is the tree of classes; every error survives a pickle."""

import copy
import pickle
import re

import pytest

from taskrpc import errors
from taskrpc.errors import Code, TaskRpcError

CLASSES = [
    cls
    for cls in vars(errors).values()
    if isinstance(cls, type) and issubclass(cls, TaskRpcError) and not cls.__name__.startswith("_")
]
EXAMPLES = [
    TaskRpcError("something", not_executed=True),
    errors.DeadlineExceeded("no response by the deadline"),
    errors.DeadlineExceeded("never sent", not_executed=True),
    errors.ServiceUnavailable("no server offers /x"),
    errors.ConnectionLost("gone", not_executed=True),
    errors.OutcomeUnknown("gone"),
    errors.TypeMismatch("differs"),
    errors.InvalidRequest("goal.x", "expected a number"),
    errors.InvalidRequest("", "not a message"),
    errors.ServerBusy("queue full", retry_after=1.5),
    errors.HandlerFailed(Code.INTERNAL, "see the log"),
    errors.HandlerFailed(Code.NOT_FOUND),
    errors.HandlerError("UNAVAILABLE", "not now"),
    errors.HandlerError(Code.ABORTED, "stopped"),
    errors.GoalFailed(Code.ABORTED, "blocked"),
    errors.GoalRejected("FAILED_PRECONDITION", "too far"),
    errors.GoalAborted(Code.ABORTED, "blocked", [1, 2]),
    errors.GoalAborted(Code.UNAVAILABLE),
    errors.GoalCanceled(Code.CANCELLED, "cancelled", [1]),
    errors.InvalidName("a b", 1, kind="node name", problem="no blanks"),
    errors.NameInUse("/x"),
    errors.CannotListen("port 1"),
    errors.WouldDeadlock("from the loop"),
    errors.ProtocolError("garbage"),
    errors.AuthenticationFailed("token"),
    errors.PermissionDenied("not you"),
    errors.SessionExpired("forgotten"),
    errors.RequestIdReused("another"),
    errors.StoreError("tasks.db: the disk is full"),
]


def documented_tree():
    """Each name in the docstring's tree, with the name that it hangs on."""
    parents, above = {}, {}
    for line in errors.__doc__.splitlines():
        found = re.match(r"( {4}[│ ├└─]*)([A-Z]\w+)( |$)", line)
        if found:
            depth = len(found[1])
            parents[found[2]] = above.get(depth - 4)
            above[depth] = found[2]
    return parents


def test_the_documented_tree_is_the_tree_of_classes():
    tree = documented_tree()
    assert sorted(tree) == sorted(cls.__name__ for cls in CLASSES)
    for name, parent in tree.items():
        if parent is not None:
            bases = [base for base in getattr(errors, name).__mro__[1:] if base in CLASSES]
            assert bases[0].__name__ == parent


def test_default_of_not_executed_is_documented():
    paragraph = errors.__doc__.split("The classes with True: ")[1]
    true, false = paragraph.split("The classes with False:")
    assert set(re.findall(r"`(\w+)`", true)) == {
        cls.__name__ for cls in CLASSES if cls.not_executed is True
    }
    assert re.findall(r"`(\w+)`", false) == [
        cls.__name__ for cls in CLASSES if cls.not_executed is False
    ]


def test_examples_include_every_class():
    assert {type(error) for error in EXAMPLES} == set(CLASSES)


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, "pickle"])
@pytest.mark.parametrize("error", EXAMPLES, ids=repr)
def test_a_copy_has_everything(error, duplicate):
    error.add_note("seen by the test")
    error.not_executed = error.not_executed  # as if the code that raised the error had set it
    again = pickle.loads(pickle.dumps(error)) if duplicate == "pickle" else duplicate(error)
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
    assert again.not_executed is error.not_executed


def test_standard_exceptions_catch_the_matching_errors():
    assert issubclass(errors.DeadlineExceeded, TimeoutError)
    assert issubclass(errors.InvalidName, ValueError)
    assert issubclass(errors.WouldDeadlock, RuntimeError)


@pytest.mark.parametrize("cls", [errors.HandlerError, errors.HandlerFailed])
def test_only_unavailable_promises_that_nothing_was_done(cls):
    for code in Code:
        assert (cls(code, "").not_executed is True) is (code is Code.UNAVAILABLE)
    assert errors.HandlerFailed(Code.INTERNAL, "").not_executed is False


def test_a_code_is_given_as_such_or_by_name():
    assert errors.HandlerError("NOT_FOUND", "x").code is Code.NOT_FOUND
    assert errors.HandlerError(5, "x").code is Code.NOT_FOUND
    assert str(errors.HandlerFailed(Code.NOT_FOUND)) == "NOT_FOUND"


@pytest.mark.parametrize("code", ["no such", "not_found", 99, None, 2.5, []])
def test_invalid_code_is_refused_with_the_valid_ones(code):
    with pytest.raises(ValueError, match="NOT_FOUND") as caught:
        errors.HandlerError(code, "x")
    assert str(caught.value).endswith(f"got {code!r}, with the message 'x'")


@pytest.mark.parametrize("code", ["the arm is stuck", "NOT_FOUND", Code.NOT_FOUND])
def test_an_error_of_a_callback_without_a_message_is_refused(code):
    with pytest.raises(errors.HandlerError.Invalid) as caught:
        errors.HandlerError(code)
    said = f"HandlerError: expected a code and a message, got only {code!r}; write HandlerError("
    assert str(caught.value).startswith(said)


def test_an_empty_path_is_the_whole_message():
    assert str(errors.InvalidRequest("", "not a message")) == "not a message"
    assert str(errors.InvalidRequest("a.b", "no")) == "a.b: no"


@pytest.mark.parametrize(
    ("text", "heard"),
    [
        ("the disk is full", "the disk is full"),
        ("/home/ana/stock.json: disk full", "…: disk full"),
        ("cannot write '/home/ana/stock.json' now", "cannot write '…' now"),
        (r"C:\Users\ana\stock.json, D:/x (\\server\share) failed", "…, … (…) failed"),
        ("~/stock.json and ./a and ../b.db; 1/2 of 3/4 is and/or not", None),
        (
            "/robot/my file.db: gone; /robot/my file.db is /robot's",
            "gone; the server's file is …'s",
        ),
    ],
)
def test_text_for_callers_names_no_file(text, heard):
    error = errors.StoreError(text)
    if "my file" in text:
        error.files = ("/robot/my file.db",)
    if heard is None:
        heard = "… and … and …; 1/2 of 3/4 is and/or not"
    assert errors.text_for_callers(error) == heard


def test_a_code_prints_its_name():
    code = errors.HandlerError("NOT_FOUND", "no such part").code
    assert (f"{code}", str(code), "%s" % code, f"{code:>10}") == (*["NOT_FOUND"] * 3, " NOT_FOUND")  # noqa: UP031
    assert (int(code), code == 5) == (5, True)


def test_code_prints_its_number_where_the_format_asks_for_one():
    code = errors.Code.NOT_FOUND
    assert (f"{code:d}", f"{code:02x}", f"{code:<10s}|") == ("5", "05", "NOT_FOUND |")


def test_error_about_a_name_in_use_can_leave_out_the_advice_to_join():
    end = "/x is already offered by a.py; end it with `taskrpc stop 4711`"
    error = errors.NameInUse(f"{end}, or join it with --join (join=True)")
    assert str(error.without_join()) == end
    assert str(error.without_join().without_join()) == end
