"""Loggers write the same lines as the loggers of ROS 2."""

import pytest

from taskrpc.ros.packages.rclpy import logging
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.logging import get_logger

pytestmark = pytest.mark.usefixtures("fresh_log")


def test_every_severity_has_its_word_and_debug_is_not_shown(capsys):
    logger = get_logger("n")
    logged = [logger.debug("m"), logger.info("m"), logger.warning("m"), logger.warn("m")]
    logged += [logger.error("m"), logger.fatal("m")]
    assert logged == [False] + [True] * 5
    words = [line[1 : line.index("]")] for line in capsys.readouterr().err.splitlines()]
    assert words == ["INFO", "WARN", "WARN", "ERROR", "FATAL"]


def test_logger_rcl_warns_about_deprecated_rules(capsys):
    context = Context()
    context.init(["p", "a:=b"])
    context.shutdown()
    assert "[rcl]: Found remap rule 'a:=b'. This syntax is deprecated." in capsys.readouterr().err


def test_log_directory_is_the_same_as_in_ros(monkeypatch, tmp_path):
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert logging.get_logging_directory() == tmp_path / ".ros" / "log"
    monkeypatch.setenv("ROS_HOME", "~/other")
    assert logging.get_logging_directory() == tmp_path / "other" / "log"
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "logs"))
    assert logging.get_logging_directory() == tmp_path / "logs"


def test_the_name_of_a_child_logger_is_a_text():
    with pytest.raises(TypeError, match=r"the name of a child logger \(str\), got 1"):
        logging.get_logger("robot").get_child(1)
