"""A folder of programs and definitions, and the packages that are made of it."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from taskrpc.cli.main import main

LAMP = """
from lamp_interfaces.srv import Switch
import common
import numpy
import rclpy
rclpy.init()
print(Switch.Response(colour=common.COLOUR))
"""


FADER = """
import rclpy
from my_robot_interfaces.srv import RobotTask
from common import COLOUR

def main():
    print(COLOUR)

if __name__ == "__main__":
    main()
"""


TAGS = set(
    "name version description maintainer license buildtool_depend depend exec_depend test_depend"
    " member_of_group export".split()
)


@pytest.fixture
def lesson(tmp_path, monkeypatch):
    folder = tmp_path / "lesson"
    (folder / "lamp_interfaces" / "srv").mkdir(parents=True)
    definition = "geometry_msgs/Point at\nbool on\n---\nstring colour\n"
    (folder / "lamp_interfaces" / "srv" / "Switch.srv").write_text(definition)
    (folder / "lamp.py").write_text(LAMP)
    (folder / "fader.py").write_text(FADER)
    (folder / "common.py").write_text("COLOUR = 'green'\n")
    (folder / "test_lamp.py").write_text("import pytest\n")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def made(lesson, capsys):
    assert main(["export", "colcon", "../out"]) == 0
    return lesson.parent / "out" / "src", capsys.readouterr().out


def _manifest(folder):
    root = ElementTree.parse(folder / "package.xml").getroot()
    assert (root.tag, root.get("format")) == ("package", "3")
    found = {}
    for element in root:
        found.setdefault(element.tag, []).append((element.text or "").strip())
    assert set(found) <= TAGS
    for once in ("name", "version", "description", "export"):
        assert len(found[once]) == 1
    assert re.fullmatch(r"\d+\.\d+\.\d+", found["version"][0])
    assert "@" in root.find("maintainer").get("email")
    assert found["name"] == [folder.name]
    return found, root.findtext("export/build_type")
