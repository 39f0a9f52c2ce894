"""`taskrpc graduate` reports what colcon or ros2 would miss in a package."""

import pytest

from taskrpc.cli.main import main
from tests.ros.graduation.sample_programs import program


def test_missing_dependencies_and_entry_points_are_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    package = ["pkg", "create", "adder", "--build-type", "ament_python", "--node-name", "one"]
    main([*package, "--dependencies", "rclpy"])
    (tmp_path / "adder" / "adder" / "two.py").write_text(program())
    capsys.readouterr()
    assert main(["graduate", "adder"]) == 1
    manifest = tmp_path / "adder" / "package.xml"
    told = capsys.readouterr().out.splitlines()
    assert [line.partition("; ")[0] for line in told] == [
        f"{manifest}:1:1: example_interfaces is imported, and not named here",
        f"{manifest}:1:1: std_msgs is imported, and not named here",
        told[2].partition("; ")[0],
    ]
    assert "adder.two has a main and no entry point in setup.py; ros2 run does" in told[2]


@pytest.fixture
def packages(tmp_path, monkeypatch, capsys):
    """A Python package and one of definitions; returns what `taskrpc graduate` prints for them."""
    monkeypatch.chdir(tmp_path)
    main(["pkg", "create", "adder", "--build-type", "ament_python", "--node-name", "one"])
    (tmp_path / "things" / "srv").mkdir(parents=True)
    (tmp_path / "things" / "srv" / "Ask.srv").write_text("---\n")
    main(["export", "colcon", "ws", "--from", "."])
    capsys.readouterr()
    manifest = tmp_path / "ws" / "src" / "things" / "package.xml"
    depends = "<exec_depend>rclpy</exec_depend>\n  <member_of_group>"
    manifest.write_text(manifest.read_text().replace("<member_of_group>", depends))

    def findings():
        code = main(["graduate", "ws/src"])
        lines = capsys.readouterr().out.splitlines()
        assert code == (lines != ["found nothing that a real ROS 2 would do differently"])
        return lines

    findings.folder = tmp_path / "ws" / "src"
    return findings


def test_created_and_exported_packages_have_no_findings(packages):
    assert packages() == ["found nothing that a real ROS 2 would do differently"]


@pytest.mark.parametrize(
    ("path", "old", "new", "said"),
    [
        ("adder/setup.py", None, "", "an ament_python package without setup.py; colcon cannot"),
        ("adder/setup.cfg", "install_scripts", "x", "setup.cfg does not name the folder"),
        ("adder/resource/adder", None, "", "there is no file resource/adder; ros2 does not know"),
        ("adder/package.xml", "<build_type>ament_python</build_type>", "", "there is no build_"),
        ("adder/package.xml", None, "", "there is no package.xml beside it; colcon builds no"),
        ("adder/launch/all.launch.py", "", "x = 1", "the folder launch is not installed; get_"),
        ("things/CMakeLists.txt", '"srv/Ask.srv"', "", "srv/Ask.srv is not built; its import is"),
        ("things/srv/New.srv", "", "---", "srv/New.srv is not built; its import is an Import"),
        ("things/package.xml", "rosidl_interface_packages", "x", "a package of definitions that"),
        (
            "things/scripts/ask.py",
            "",
            "import rclpy",
            "scripts/ask.py is not installed; ros2 run does",
        ),
    ],
)
def test_missing_parts_of_a_package_are_reported(packages, path, old, new, said):
    file = packages.folder / path
    if old is None:
        file.unlink()
    else:
        file.parent.mkdir(exist_ok=True)
        text = file.read_text() if file.exists() else ""
        file.write_text(text.replace(old, new) if old else new)
    (told,) = packages()
    assert f":1:1: {said}" in told


def test_scripts_and_folders_that_cmake_installs_have_no_findings(packages):
    things = packages.folder / "things"
    (things / "scripts").mkdir()
    (things / "config").mkdir()
    (things / "scripts" / "ask.py").write_text("import rclpy\n")
    (things / "scripts" / "helper.py").write_text("# whatever import rclpy says\n")
    (things / "config" / "a.yaml").write_text("x: 1\n")
    text = (things / "CMakeLists.txt").read_text()
    for line in (
        "install(DIRECTORY scripts config DESTINATION share/${PROJECT_NAME})",
        "install(PROGRAMS scripts/ask.py DESTINATION lib/x)\n"
        "install(DIRECTORY config DESTINATION x)",
    ):
        (things / "CMakeLists.txt").write_text(f"{text}{line}\n")
        assert packages() == ["found nothing that a real ROS 2 would do differently"]


@pytest.mark.parametrize(
    ("setup_cfg", "setup_py"),
    [
        ("[develop]\nscript-dir=$base/lib/adder\n[install]\ninstall-scripts=$base/lib/adder\n", ""),
        ("", "# options={'install': {'install_scripts': '$base/lib/adder'}}\n"),
    ],
)
def test_folder_for_executables_may_be_set_in_other_ways(packages, setup_cfg, setup_py):
    adder = packages.folder / "adder"
    (adder / "setup.cfg").write_text(setup_cfg)
    (adder / "setup.py").write_text((adder / "setup.py").read_text() + setup_py)
    assert packages() == ["found nothing that a real ROS 2 would do differently"]
