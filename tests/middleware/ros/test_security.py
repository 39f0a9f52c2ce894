"""One line about a wrong setting of SROS 2."""

from __future__ import annotations

import pytest

from taskrpc.middleware.ros.security import security_problem

ON = {"ROS_SECURITY_ENABLE": "true"}
STORE = ON | {"ROS_SECURITY_KEYSTORE": "/keys/"}


@pytest.mark.parametrize(
    ("settings", "error", "expected"),
    [
        ({}, "error not set", ""),
        ({"ROS_SECURITY_ENABLE": "false"}, "error not set", ""),
        (ON, "error not set", "ROS_SECURITY_KEYSTORE must name a keystore, but it is not set"),
        (STORE, "x", "the enclave / in /keys/enclaves, but there is no such folder"),
        (
            STORE | {"ROS_SECURITY_ENCLAVE_OVERRIDE": "/robot/arm"},
            "x",
            "the enclave /robot/arm in /keys/enclaves/robot/arm, but there is no such folder;"
            " create it: ros2 security create_enclave /keys/ /robot/arm",
        ),
        (
            STORE,
            "This Fast DDS version doesn't have the security libraries",
            "this Fast DDS was built without security",
        ),
    ],
)
def test_wrong_setting_is_explained(settings, error, expected):
    problem = security_problem(settings, error, lambda folder: False)
    assert expected in problem
    assert bool(problem) == bool(expected)


def test_complete_settings_are_no_problem():
    folders = {"/keys/enclaves"}
    assert security_problem(STORE, "permission denied", folders.__contains__) == ""
