"""Substitutions that run something."""

import shlex
import sys

import pytest


def test_expression_knows_modules(launch, perform):
    expression = launch.substitutions.PythonExpression
    assert perform(expression(["'", "a", "' == 'a'"])) == "True"
    assert perform(expression("floor(pi) + math.floor(pi)")) == "6"
    assert perform(expression("os.sep != ''", ["os"])) == "True"
    with pytest.raises(launch.SubstitutionFailure, match=r"cannot evaluate .* NameError"):
        perform(expression("nope"))


@pytest.mark.real_time
@pytest.mark.skipif(sys.platform == "win32", reason="a line for sh")
def test_command_gives_its_output_or_an_error(launch, perform):
    def command(code, **options):
        line = f"{shlex.quote(sys.executable)} -c {shlex.quote(code)}"
        return launch.substitutions.Command(line, **options)

    loud = "import sys; print('out'); print('err', file=sys.stderr)"
    assert perform(command("print(5)")) == "5\n"
    assert perform(command(loud, on_stderr="ignore")) == "out\n"
    for code, problem in (
        ("import sys; sys.exit(3)", "executed command failed. Command: "),
        (loud, "executed command showed stderr output"),
    ):
        with pytest.raises(launch.SubstitutionFailure, match=problem):
            perform(command(code))
    with pytest.raises(launch.SubstitutionFailure, match="file not found"):
        perform(launch.substitutions.Command("no-such-command-9 x"))


def test_executable_is_found_on_the_path(launch, perform, tmp_path, monkeypatch):
    name = "tool.exe" if sys.platform == "win32" else "tool"
    (tmp_path / name).write_text("")
    (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    find = launch.substitutions.FindExecutable
    assert perform(find(name=name)) == str(tmp_path / name)
    with pytest.raises(launch.SubstitutionFailure, match="executable 'nope' not found on the PATH"):
        perform(find(name="nope"))
