"""Loggers write what ROS 2's write, when they would."""

import pytest

from taskrpc.rclpy import logging
from taskrpc.rclpy.context import Context
from taskrpc.rclpy.logging import get_logger

pytestmark = pytest.mark.usefixtures("fresh_log")


def test_every_severity_has_its_word_and_debug_is_not_shown(capsys):
    logger = get_logger("n")
    logged = [logger.debug("m"), logger.info("m"), logger.warning("m"), logger.warn("m")]
    logged += [logger.error("m"), logger.fatal("m")]
    assert logged == [False] + [True] * 5
    words = [line[1 : line.index("]")] for line in capsys.readouterr().err.splitlines()]
    assert words == ["INFO", "WARN", "WARN", "ERROR", "FATAL"]


def test_deprecated_rules_are_warned_of_by_the_logger_rcl(capsys):
    context = Context()
    context.init(["p", "a:=b"])
    context.shutdown()
    assert "[rcl]: Found remap rule 'a:=b'. This syntax is deprecated." in capsys.readouterr().err


def test_the_directory_of_logs_is_where_ros_has_it(monkeypatch, tmp_path):
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert logging.get_logging_directory() == tmp_path / ".ros" / "log"
    monkeypatch.setenv("ROS_HOME", "~/other")
    assert logging.get_logging_directory() == tmp_path / "other" / "log"
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "logs"))
    assert logging.get_logging_directory() == tmp_path / "logs"
