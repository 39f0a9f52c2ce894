"""Substitutions that run something."""

import importlib
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


def test_xacro_finds_the_packages_of_the_workspace(launch, perform, tmp_path, monkeypatch):
    hook = importlib.import_module("taskrpc.ros.hook")
    package = tmp_path / "ws" / "src" / "arm"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm</name></package>")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "xacro.py").write_text(
        "import sys\n"
        "from ament_index_python.packages import get_package_share_directory\n"
        "def main():\n"
        "    print(sys.argv[1:], get_package_share_directory('arm'))\n"
    )
    monkeypatch.syspath_prepend(tmp_path / "lib")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "lib"))
    monkeypatch.setattr(hook._workspace, "starts", [package])
    monkeypatch.chdir(tmp_path)
    command = launch.substitutions.Command("xacro a.xacro name:=one")
    assert perform(command) == f"['a.xacro', 'name:=one'] {package}\n"
