"""turtlesim's programs, in a domain of their own."""

import pytest

from tests.ros.turtlesim.running import turtlesim_in


@pytest.fixture
def turtlesim(tmp_path, monkeypatch, capsys):
    with turtlesim_in(tmp_path, monkeypatch, capsys) as turtlesim:
        yield turtlesim
