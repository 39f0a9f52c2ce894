"""What the checks of lab 6 say about answers."""

import pytest

from taskrpc.course.labs.checks.lab6 import expect_answers
from taskrpc.course.labs.lab import NotMet

FAULTS = {"robot.py": "exception", "planner.py": "deadlock", "console.py": "wrong-type"}
RIGHT = """
# a remark
robot.py | exception | taskrpc service call /r2/battery std_srvs/srv/Trigger
planner.py| deadlock |taskrpc run planner.py
 console.py | wrong-type | taskrpc service type /r2/light
"""


def test_answers_in_any_spacing_are_accepted():
    expect_answers(RIGHT, FAULTS)


def test_answers_in_a_table_with_outer_bars_are_accepted():
    lines = [f"| {line} |" for line in RIGHT.splitlines() if "|" in line]
    expect_answers("\n".join(lines), FAULTS)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (RIGHT, "", r"expected a line `robot\.py \| FAULT \| COMMAND` in answers\.txt; there is"),
        ("| deadlock |", "- deadlock -", r"a line `planner\.py \|"),
        ("| deadlock |", "| ? |", r"the name of a fault for planner\.py: blocking-sleep, .*'\?'"),
        ("| deadlock |", "| exception |", r"exception, which is not the fault of this file"),
        ("taskrpc run planner.py", "?", r"a command that shows the fault of planner\.py.*'\?'"),
        ("service type", "interface show", r"a command that shows the fault of console\.py"),
    ],
)
def test_another_answer_is_explained_and_the_fault_not_named(old, new, message):
    with pytest.raises(NotMet, match=message):
        expect_answers(RIGHT.replace(old, new), FAULTS)
