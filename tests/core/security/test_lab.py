"""The lab that a user has joined is remembered for this user only, and forgotten on request."""

import os
import stat
import sys

import pytest

from taskrpc.core.security import lab
from taskrpc.core.system import folders, private_files
from taskrpc.errors import TaskRpcError

LAB = lab.Lab(address="192.168.1.20:7450", token="ada.secret", certificate="PEM", domain=7)


def test_remembered_lab_is_read_until_it_is_forgotten():
    assert lab.remembered_lab() is None
    lab.remember_lab(LAB)
    assert lab.remembered_lab() == LAB
    assert lab.forget_lab()
    assert lab.remembered_lab() is None
    assert not lab.forget_lab()


def test_reading_the_lab_creates_no_folder():
    lab.remembered_lab()
    assert not folders.find_state_dir().exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps it in the user's profile")
def test_only_this_user_can_read_the_lab_file():
    lab.remember_lab(LAB)
    assert stat.S_IMODE(lab.lab_file().stat().st_mode) == 0o600


def test_failed_write_keeps_the_earlier_lab(monkeypatch):
    lab.remember_lab(LAB)

    def refuse(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OSError, match="no space"):
        private_files.write_private(lab.lab_file(), b"half")
    assert lab.remembered_lab() == LAB
    assert os.listdir(lab.lab_file().parent) == ["lab.json"]


def test_invalid_lab_file_is_named():
    folders.state_dir()
    lab.lab_file().write_text("{}")
    with pytest.raises(
        TaskRpcError, match=r"lab\.json: .*`address`.*; `taskrpc join --leave` removes it"
    ):
        lab.remembered_lab()


def test_the_token_is_not_printed():
    assert "secret" not in repr(LAB)


@pytest.mark.parametrize(
    ("namespace", "robot"),
    [("/ada", "/"), ("/", "/"), ("/robot2/ada", "/robot2")],
)
def test_robot_of_a_user_is_in_the_namespace_above(namespace, robot):
    found = lab.Lab(address="h:1", token="ada.secret", certificate="PEM", namespace=namespace)
    assert found.robot_namespace == robot


def test_first_robot_has_the_root_namespace():
    assert [lab.robot_namespace(number) for number in (1, 2, 3)] == ["/", "/robot2", "/robot3"]
