"""`taskrpc door` explains a policy, shows its mistakes, and decides one request."""

import pytest

POLICY = """\
agents:
  may: [call /robot_task]
  limits: {/robot_task: {priority: 1..5}}
  ask: [publish /cmd_vel]
students:
  may: [read /*]
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "door.yaml"
    path.write_text(POLICY, encoding="utf-8")
    return path


def test_check_explains_each_name(file, run):
    code, out, err = run("door", "check", "door.yaml")
    assert (code, err) == (0, "")
    assert out.startswith("agents (line 1)\n  may publish /cmd_vel after a person")
    assert "\nstudents (line 5)\n  may read /*, except hidden names" in out


def test_check_shows_a_mistake_with_a_caret(file, run):
    file.write_text("agents:\n  may: [call robot_task]\n", encoding="utf-8")
    code, out, err = run("door", "check", "door.yaml")
    assert (code, out) == (1, "")
    assert err == (
        "door.yaml:2:14: error: expected an absolute name, because a policy belongs to no node:"
        " write /robot_task\n      may: [call robot_task]\n                 ^\n"
    )


def test_a_missing_file_is_an_error(file, run):
    code, _, err = run("door", "check", "none.yaml")
    assert code == 1
    assert err.startswith("none.yaml: error: cannot read the policy: ")


def test_a_missing_argument_is_a_usage_error(run):
    assert run("door", "check")[0] == 2
    assert run("door", "explain")[0] == 2


@pytest.mark.real_time
def test_check_compares_names_with_the_running_programs(server, file, run):
    file.write_text("a: {may: [call /add_two_int, read /told]}\n", encoding="utf-8")
    code, _, err = run("door", "check", "door.yaml", "--running")
    assert code == 1
    assert "1:16: error: no running program has /add_two_int; did you mean /add_two_ints?" in err
    file.write_text("a: {may: [call /add_two_ints, read /told]}\n", encoding="utf-8")
    assert run("door", "check", "door.yaml", "--running")[0] == 0


def test_explain_can_be_about_one_name(file, run):
    assert run("door", "explain", "door.yaml", "students")[1].startswith("students (line 5)")
    assert run("door", "explain", "door.yaml")[1].startswith("agents (line 1)")
    code, _, err = run("door", "explain", "door.yaml", "student")
    assert (code, err) == (
        1,
        "door.yaml has no rules for 'student'\n  hint: did you mean students?\n",
    )


@pytest.mark.parametrize(
    ("arguments", "code", "out"),
    [
        (
            ["agents", "/robot_task", "{priority: 9}"],
            1,
            "refused by line 3 of the policy: priority: expected 1 to 5, got 9\n"
            "    limits: {/robot_task: {priority: 1..5}}\n",
        ),
        (
            ["agents", "robot_task", "{priority: 5}"],
            0,
            "allowed by line 2 of the policy\n    may: [call /robot_task]\n",
        ),
        (
            ["agents", "/cmd_vel", "--verb", "publish"],
            0,
            "needs approval within 60 s by line 4 of the policy\n    ask: [publish /cmd_vel]\n",
        ),
    ],
)
def test_explain_decides_a_request(file, run, arguments, code, out):
    assert run("door", "explain", "door.yaml", *arguments) == (code, out, "")


@pytest.mark.parametrize("values", ["[1]", "priority", "{", "{a: .nan: 1}"])
def test_values_that_are_no_fields_are_an_error(file, run, values):
    code, _, err = run("door", "explain", "door.yaml", "agents", "/robot_task", values)
    assert code == 1
    assert err.startswith("expected YAML such as {priority: 3}, got ")
