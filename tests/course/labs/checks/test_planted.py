"""The faults of lab 6: in which programs they are, and which commands show them."""

from pathlib import Path

import pytest

import taskrpc.course.labs.starter
from taskrpc.course.labs.checks.planted import FAULTS, FILES, faults_of, shows, values_with
from taskrpc.course.labs.starter import filled
from taskrpc.course.labs.variants import Variant

TEMPLATES = Path(taskrpc.course.labs.starter.__file__).parent / "files" / "lab6"
PLANTED = [(file, fault) for file in FILES for fault in FAULTS[file]]


def test_each_program_of_a_variant_has_one_of_its_faults():
    variants = [faults_of(Variant(str(number))) for number in range(200)]
    assert all(set(faults) == set(FILES) for faults in variants)
    assert {(file, fault) for faults in variants for file, fault in faults.items()} == set(PLANTED)


@pytest.mark.parametrize(("file", "fault"), PLANTED)
def test_a_fault_changes_its_program_only_and_leaves_it_valid_python(file, fault):
    right, wrong = values_with({}, "r2"), values_with({file: fault}, "r2")
    for name in FILES:
        text = (TEMPLATES / name).read_text(encoding="utf-8")
        assert (filled(text, right) == filled(text, wrong)) == (name != file)
        compile(filled(text, wrong), name, "exec")


@pytest.mark.parametrize(
    ("command", "fault"),
    [
        ("taskrpc service call /r2/light std_srvs/srv/SetBool '{data: true}'", "exception"),
        ("`taskrpc run robot.py`", "forgotten-return"),
        ("$ taskrpc node info /planner", "wrong-name"),
        ("ros2 service type /r2/light", "wrong-type"),
        ("taskrpc-call /r2/scan", "blocking-sleep"),
        ("taskrpc service call /mission 'unfinished", "deadlock"),
    ],
)
def test_a_command_that_shows_a_fault_is_accepted(command, fault):
    assert shows(command, fault)


@pytest.mark.parametrize(
    ("command", "fault"),
    [
        ("", "exception"),
        ("?", "exception"),
        ("taskrpc", "exception"),
        ("taskrpc service", "exception"),
        ("taskrpc service type /r2/light", "exception"),
        ("taskrpc service caller", "exception"),
        ("cat robot.py", "exception"),
        ("taskrpc doctor", "wrong-type"),
    ],
)
def test_another_command_is_refused(command, fault):
    assert not shows(command, fault)
