"""Runs `taskrpc pkg` in an empty folder."""

from __future__ import annotations

import pytest

from taskrpc.cli.main import main


@pytest.fixture
def pkg(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CONFIG_COUNT", "1")
    monkeypatch.setenv("GIT_CONFIG_KEY_0", "user.email")
    monkeypatch.setenv("GIT_CONFIG_VALUE_0", "ana@example.com")

    def pkg(*arguments):
        code = main(["pkg", *arguments])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return pkg


def _create_python(pkg):
    return pkg(
        *("create", "--build-type", "ament_python", "--license", "Apache-2.0"),
        *("--node-name", "my_node", "--maintainer-name", "Ana & Co", "my_package"),
        *("--dependencies", "rclpy", "example_interfaces"),
    )
