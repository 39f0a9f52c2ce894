"""The faults of lab 6: the text of each, the files they can be in, the commands that show them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from taskrpc.course.labs.variants import Variant

FILES = ("robot.py", "planner.py", "console.py")
FAULTS: Mapping[str, Sequence[str]] = {
    "robot.py": (
        "forgotten-return",
        "exception",
        "misspelled-field",
        "nobody-spins",
        "blocking-sleep",
    ),
    "planner.py": ("deadlock", "wrong-name", "two-servers"),
    "console.py": ("wrong-type", "short-timeout", "wrong-name"),
}
"""The faults that a program of the lab can have."""

_CORRECT = {
    "BATTERY": 'f"{self.percent} percent"',
    "SUCCESS": "response.success = True",
    "RETURN": "\n        return response",
    "PAUSE": "await self.pause(2.0)",
    "SPIN": "rclpy.spin(node)",
    "SECOND_SERVER": "",
    "SECOND_CALLBACK": "",
    "MISSION": """\
async def mission(self, request, response):
        battery = await self.battery.call_async(Trigger.Request())
        scan = await self.scan.call_async(Trigger.Request())""",
    "LIGHT_TYPE": "SetBool",
    "LIGHT_REQUEST": "SetBool.Request(data=True)",
    "TIMEOUT": "10.0",
}
_PLANTED: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("robot.py", "forgotten-return"): {"RETURN": ""},
    ("robot.py", "exception"): {"BATTERY": 'f"{self.charge} percent"'},
    ("robot.py", "misspelled-field"): {"SUCCESS": "response.sucess = True"},
    ("robot.py", "nobody-spins"): {
        "SPIN": "while rclpy.ok():\n            time.sleep(0.1)",
    },
    ("robot.py", "blocking-sleep"): {"PAUSE": "time.sleep(2.0)"},
    ("planner.py", "deadlock"): {
        "MISSION": """\
def mission(self, request, response):
        battery = self.battery.call(Trigger.Request())
        scan = self.scan.call(Trigger.Request())""",
    },
    ("planner.py", "wrong-name"): {"BATTERY_NAME": "battery"},
    ("planner.py", "two-servers"): {
        "SECOND_SERVER": """
        self.create_service(Trigger, "/@ROBOT@/battery", self.level, callback_group=group)""",
        "SECOND_CALLBACK": """

    def level(self, request, response):
        response.success = True
        response.message = "100 percent"
        return response""",
    },
    ("console.py", "wrong-type"): {
        "LIGHT_TYPE": "Trigger",
        "LIGHT_REQUEST": "Trigger.Request()",
    },
    ("console.py", "short-timeout"): {"TIMEOUT": "1.0"},
    ("console.py", "wrong-name"): {"LIGHT_NAME": "/light"},
}
"""The text of each fault, in place of the correct text."""


SHOWN_BY: Mapping[str, Sequence[str]] = {
    "forgotten-return": ("service call", "run"),
    "exception": ("service call", "run"),
    "misspelled-field": ("service call", "run"),
    "nobody-spins": ("service call", "run"),
    "blocking-sleep": ("service call", "service echo", "run"),
    "deadlock": ("service call", "run"),
    "wrong-name": ("node info", "service list", "service info", "run"),
    "two-servers": ("service list", "service info", "node info", "doctor", "ps", "run"),
    "wrong-type": (
        *("service type", "service list", "service info", "service find", "node info", "run"),
    ),
    "short-timeout": ("service call", "service echo", "run"),
}
"""The commands that show a fault; `run` stands for the log of a program."""


def faults_of(variant: Variant) -> Mapping[str, str]:
    """Return the fault of each program of a variant."""
    return {file: variant.choose(file, FAULTS[file]) for file in FILES}


def values_with(faults: Mapping[str, str], robot: str) -> dict[str, str]:
    """Return the texts of the starter files, with these faults planted."""
    values = {"BATTERY_NAME": f"/{robot}/battery", "LIGHT_NAME": f"/{robot}/light", **_CORRECT}
    for file, fault in faults.items():
        values |= _PLANTED[file, fault]
    return {name: text.replace("@ROBOT@", robot) for name, text in values.items()} | {
        "ROBOT": robot
    }


def shows(command: str, fault: str) -> bool:
    """Return whether a command, as a student writes it down, shows a fault."""
    try:
        words = shlex.split(command.strip("`$ "))
    except ValueError:
        words = command.split()
    if words[:1] == ["taskrpc-call"]:
        words = ["taskrpc", "service", "call"]
    given = " ".join(words[1:])
    return words[:1] in (["taskrpc"], ["ros2"]) and any(
        f"{given} ".startswith(f"{one} ") for one in SHOWN_BY[fault]
    )
