"""Lab 6: three programs with a planted fault each, and the commands that show them."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from typing import TYPE_CHECKING, Any, Final

import srvgen
from taskrpc.client import Client
from taskrpc.course.labs.checks.common import answer, ended, service_of
from taskrpc.course.labs.checks.planted import (
    FAULTS,
    FILES,
    SHOWN_BY,
    faults_of,
    shows,
    values_with,
)
from taskrpc.course.labs.lab import Check, Lab, NotMet
from taskrpc.course.labs.trial import Call, Program, Trial
from taskrpc.course.labs.variants import Variant

if TYPE_CHECKING:
    from srvgen.stubs.std_srvs.srv import SetBool, Trigger

_TRIGGER: Final = "std_srvs/srv/Trigger"
_SET_BOOL: Final = "std_srvs/srv/SetBool"
_SCAN = 2.0
"""Seconds that a scan takes."""
_RESPONDED = 60.0
"""Virtual seconds that the robot has for a scan and its battery."""
_ENDED = 40.0
"""Seconds that the console has for both calls, each with a wait for its server."""

_ROBOTS = ("r2", "walle", "marvin", "robby", "data")


def _robot(variant: Variant) -> str:
    return variant.choose("robot", _ROBOTS)


def _values(variant: Variant) -> Mapping[str, str]:
    faults = faults_of(variant)
    answers: dict[str, str] = {}
    for file, fault in faults.items():
        name = file.removesuffix(".py").upper()
        answers |= {f"FAULT_{name}": fault, f"COMMAND_{name}": f"taskrpc {SHOWN_BY[fault][0]}"}
    return values_with(faults, _robot(variant)) | answers


async def _robot_answers(trial: Trial) -> None:
    robot = await trial.start("robot.py")
    trigger, set_bool = srvgen.load(_TRIGGER), srvgen.load(_SET_BOOL)
    name = _robot(trial.variant)
    clients = [
        await service_of(trial, robot, srv_type, f"/{name}/{service}")
        for service, srv_type in (("battery", trigger), ("light", set_bool), ("scan", trigger))
    ]
    battery, light, scan = clients
    for client, request, words, expected in (
        (battery, trigger.Request(), "an empty request", "87 percent"),
        (light, set_bool.Request(data=True), "data=True", "the light is on"),
        (light, set_bool.Request(data=False), "data=False", "the light is off"),
        (scan, trigger.Request(), "an empty request", "3 objects"),
    ):
        response = await answer(client, request, words)
        if (response.success, response.message) != (True, expected):
            raise NotMet(
                f"success=True and message={expected!r} of {client.service_name} to {words}",
                f"success={response.success} and message={response.message!r}",
                "change only what is wrong: the messages of the starter file are right",
            )


async def _robot_is_responsive(trial: Trial) -> None:
    name = _robot(trial.variant)
    request = srvgen.load(_TRIGGER).Request()
    calls = [
        Call(_TRIGGER, f"/{name}/scan", request, 0.0),
        Call(_TRIGGER, f"/{name}/battery", request, _SCAN / 10),
    ]
    robot = await trial.simulate("robot.py", duration=_RESPONDED, calls=calls)
    for call, response in zip(calls, robot.responses, strict=True):
        if response.message is None:
            raise NotMet(
                f"a response of {call.name}, although /{name}/scan and /{name}/battery are called"
                " at the same time",
                response.problem or robot.problem or f"there was none within {_RESPONDED:g} s",
                "what does the callback wait for? Print a line before and after it",
            )
    scan, battery = robot.responses
    if scan.time - scan.began < _SCAN / 2:
        raise NotMet(
            f"a scan of {_SCAN:g} s, as the scanner needs",
            f"/{name}/scan responded after {scan.time - scan.began:.1f} s",
            "the scanner stays as slow as it is; the other services must not wait for it",
        )
    if battery.time >= scan.time:
        raise NotMet(
            f"a response of /{name}/battery while /{name}/scan still runs",
            "it came only after that of the scan",
            "what does the only thread of the program do for two seconds?",
        )


@asynccontextmanager
async def _servers(trial: Trial, **callbacks: Any) -> AsyncIterator[None]:
    """Offer services while the block runs: `battery=(srv_type, name, callback)`."""
    async with AsyncExitStack() as stack:
        for srv_type, name, callback in callbacks.values():
            service = trial.node.create_service(srv_type, name, callback, concurrency=10)
            stack.callback(service.destroy)
        yield


async def _mission_works(trial: Trial) -> None:
    trigger = srvgen.load(_TRIGGER)
    name = _robot(trial.variant)
    level, objects = trial.unpredictable(10, 99), trial.unpredictable(100, 999)
    called: list[str] = []

    async def battery(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        called.append(f"/{name}/battery")
        response.success, response.message = True, f"{level} percent"
        return response

    async def scan(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        called.append(f"/{name}/scan")
        response.success, response.message = True, f"{objects} objects"
        return response

    async with _servers(
        trial,
        battery=(trigger, f"/{name}/battery", battery),
        scan=(trigger, f"/{name}/scan", scan),
    ):
        planner = await trial.start("planner.py")
        client = await service_of(trial, planner, trigger, "/mission")
        message = await _mission(client, planner, called)
        wanted = f"battery: {level} percent; scan: {objects} objects"
        if message != wanted:
            raise NotMet(
                f"/mission to respond with what the robot says, here {wanted!r}",
                f"message={message!r}",
                "the planner must ask the robot each time",
            )


async def _mission(
    client: Client[Trigger.Request, Trigger.Response], planner: Program, called: Sequence[str]
) -> str:
    try:
        response = await answer(client, srvgen.load(_TRIGGER).Request(), "an empty request")
    except NotMet as problem:
        log = next((line for line in reversed(planner.output) if "[taskrpc]" in line), "")
        raise NotMet(
            problem.expected,
            f"{problem.happened}; of the robot it called {' and '.join(called) or 'nothing'}"
            + (f"; its log says: {log}" if log else ""),
            "`taskrpc node info /planner` shows the services that it wants to call",
        ) from None
    return str(response.message)


async def _console_works(trial: Trial) -> None:
    name = _robot(trial.variant)
    number = trial.unpredictable(10**6, 10**7 - 1)
    called: list[str] = []

    async def light(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        called.append(f"/{name}/light")
        response.success = True
        response.message = f"light {number} is {'on' if request.data else 'off'}"
        return response

    async def mission(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        called.append("/mission")
        await trial.sleep(1.25 * _SCAN)
        response.success, response.message = True, f"mission {number} is done"
        return response

    trigger, set_bool = srvgen.load(_TRIGGER), srvgen.load(_SET_BOOL)
    async with _servers(
        trial,
        light=(set_bool, f"/{name}/light", light),
        mission=(trigger, "/mission", mission),
    ):
        console = await trial.start("console.py")
        code = await console.finished(_ENDED)
    for service, wanted in (
        (f"/{name}/light", f"light {number} is on"),
        ("/mission", f"mission {number} is done"),
    ):
        if not any(wanted in line for line in console.output):
            wrote = "it still runs" if code is None else ended(console, code)
            raise NotMet(
                f"the console to call {service} and to print its response, here {wanted!r}",
                f"{wrote}; the server received {'its' if service in called else 'no'} request",
                f"the response came after {1.25 * _SCAN:g} s; how long does the console wait?"
                if service == "/mission" and service in called
                else "which name and which type does the server have, and which the client?",
            )


async def _answers(trial: Trial) -> None:
    path = trial.folder / "answers.txt"
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    expect_answers(text, faults_of(trial.variant))


def expect_answers(text: str, faults: Mapping[str, str]) -> None:
    """Raise NotMet if the answers do not name each fault, and a command that shows it."""
    lines = [[part.strip() for part in _inner(line).split("|")] for line in text.splitlines()]
    answers = {line[0]: line[1:] for line in lines if len(line) == 3}
    for file, fault in faults.items():
        if file not in answers:
            raise NotMet(
                f"a line `{file} | FAULT | COMMAND` in answers.txt",
                "there is none",
                "FAULT is a name of the sheet's table; two bars separate the three parts",
            )
        given, command = answers[file]
        known = sorted({name for names in FAULTS.values() for name in names})
        if given not in known:
            raise NotMet(
                f"the name of a fault for {file}: {', '.join(known)}",
                f"{given!r}",
                "the sheet says what each name means",
            )
        if given != fault:
            raise NotMet(
                f"the fault that was planted in {file}",
                f"{given}, which is not the fault of this file",
                "what did the program do before you corrected it, and what does it do now?",
            )
        if not shows(command, fault):
            raise NotMet(
                f"a command that shows the fault of {file}, such as `taskrpc service call ...`",
                f"{command!r}",
                "which command made the fault visible? `taskrpc run` stands for a program's log",
            )


def _inner(line: str) -> str:
    """Return a line without the outer bars that tables often have."""
    line = line.strip()
    return line[1:].removesuffix("|") if line.startswith("|") else line


_ANSWERS = "the robot answers each request"

LAB = Lab(
    number=6,
    title="Debugging",
    minutes=25,
    goal="You can find out with the command line why a service does not answer.",
    files=(*FILES, "answers.txt"),
    values=_values,
    is_simulated=True,
    checks=(
        Check(_ANSWERS, 2.5, _robot_answers),
        Check("the robot answers while it scans", 1.5, _robot_is_responsive, needs=(_ANSWERS,)),
        Check("the planner's mission uses the robot", 2.5, _mission_works),
        Check("the console prints both responses", 2, _console_works),
        Check("the answers name the faults", 1.5, _answers),
    ),
)
