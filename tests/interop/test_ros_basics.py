"""The small parts of rclpy do the same on the real rclpy and here."""

from __future__ import annotations

import os
import sys

from tests.interop.conftest import FOLDER
from tests.interop.test_ros_actions import output

PROGRAM = FOLDER / "ros_basics_program.py"


def test_names_values_parameters_and_filters_are_as_in_ros(ros_python):
    domain = 2 * (os.getpid() % 50)
    there, _ = output([ros_python], PROGRAM, domain)
    here, _ = output([sys.executable, "-m", "taskrpc", "run"], PROGRAM, domain + 1)
    assert len(there) > 120
    assert here == there
