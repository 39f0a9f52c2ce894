"""The base class of actions that start a program."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Mapping
from typing import Any, NamedTuple

from taskrpc.ros.process_tree import ProcessTree
from taskrpc.spi import os_errors

from ..action import Action
from ..conditions import evaluate_condition_expression
from ..event import Event
from ..event_handler import BaseEventHandler
from ..event_handlers import OnProcessExit
from ..events.general import Shutdown
from ..events.process import (
    ProcessExited,
    ProcessStarted,
    ProcessStderr,
    ProcessStdout,
    ShutdownProcess,
    SignalProcess,
)
from ..launch_context import LaunchContext
from ..logging import get_logger, launch_config, output_targets
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import normalize_to_list_of_substitutions, perform, perform_substitutions
from ..utilities.locations import remember_location
from ..utilities.type_utils import perform_typed_substitution

_COUNT = "number of programs"
_LONGEST_LINE = 2**20
"""Bytes without the end of a line after which the launch prints them nevertheless."""
_STREAMS = {1: "stdout", 2: "stderr"}
_KINDS = {1: ProcessStdout, 2: ProcessStderr}


class PreparedCommand(NamedTuple):
    """A program that is ready to start."""

    name: str
    """The program's name without its number, such as `talker`."""
    command: list[str] | str
    """The program and its arguments, or a line for the shell."""
    shown: list[str]
    """The command as log lines and events show it."""
    cwd: str | None = None
    env: Mapping[str, str] | None = None


class ExecuteLocal(Action):
    """Starts a program, shows its output, and ends it when the launch shuts down.

    Subclasses say which program: `prepare_command`.

    Args:
        sigterm_timeout: seconds after SIGINT until the program gets SIGTERM.
        sigkill_timeout: seconds after SIGTERM until the program gets SIGKILL.
        emulate_tty: let the program write to a terminal instead of a pipe.
        output: where its output goes: `screen`, `log`, `both`, `own_log` or `full`.
        output_format: the format of a line, with `{line}` and `{this}`.
        cached_output: keep the output for `get_stdout` and `get_stderr`.
        log_cmd: print the command before it starts.
        on_exit: entities to execute when the program has ended, or a function that returns them.
        respawn: start the program again when it has ended.
        respawn_delay: seconds until then.
        respawn_max_retries: how often; -1 for any number.
    """

    def __init__(
        self,
        *,
        shell: bool = False,
        sigterm_timeout: SomeSubstitutionsType | None = None,
        sigkill_timeout: SomeSubstitutionsType | None = None,
        emulate_tty: Any = False,
        output: Any = "log",
        output_format: str = "[{this.final_name}] {line}",
        cached_output: bool = False,
        log_cmd: bool = False,
        on_exit: Any = None,
        respawn: Any = False,
        respawn_delay: float | None = None,
        respawn_max_retries: int = -1,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self._shell = shell
        self._timeouts = (
            ("sigterm_timeout", sigterm_timeout),
            ("sigkill_timeout", sigkill_timeout),
        )
        self._emulate_tty = emulate_tty
        self._output = output
        self._output_format = output_format
        self._cached_output = cached_output
        self._log_cmd = log_cmd
        self._on_exit = on_exit
        self._respawn = respawn
        self._respawn_delay = respawn_delay
        self._respawn_max_retries = respawn_max_retries
        self._retries_left = 0
        self._details: dict[str, Any] | None = None
        self._tree: ProcessTree | None = None
        self._completed: asyncio.Future[None] | None = None
        self._ends: asyncio.Event = asyncio.Event()
        """Set when the program must end, or must not start."""
        self._started = asyncio.Event()
        """Set when the program has started, or cannot be started."""
        self._begun: dict[int, bytearray] = {}
        """The line that is not complete yet, by stream."""
        self._cached: dict[int, list[str]] = {1: [], 2: []}
        self._tasks: set[asyncio.Task[None]] = set()

    # What subclasses and programs use

    def prepare_command(self, context: LaunchContext) -> PreparedCommand | None:
        """The program to start; None if there is nothing to start."""
        raise NotImplementedError

    @property
    def shell(self) -> bool:
        """Whether the shell executes the command."""
        return self._shell

    @property
    def output(self) -> Any:
        """Where the output goes."""
        return self._output

    @property
    def process_details(self) -> dict[str, Any] | None:
        """Name, command, working directory, environment and pid; None before the start."""
        return self._details

    @property
    def final_name(self) -> str:
        """The program's name with its number, such as `talker-1`."""
        return "" if self._details is None else str(self._details["name"])

    @property
    def return_code(self) -> int | None:
        """The exit code; None while the program runs, and before."""
        return None if self._tree is None else self._tree.returncode

    def get_stdout(self) -> str:
        """The output that was kept; raises RuntimeError without `cached_output`."""
        return self._kept(1)

    def get_stderr(self) -> str:
        """The error output that was kept; raises RuntimeError without `cached_output`."""
        return self._kept(2)

    def _kept(self, stream: int) -> str:
        if not self._cached_output:
            raise RuntimeError(
                f"cached output must be true to be able to get {_STREAMS[stream]},"
                f" proc '{self.final_name}'"
            )
        return "".join(self._cached[stream])

    def get_sub_entities(self) -> list[Any]:
        """The entities that are executed when the program has ended."""
        return self._on_exit if isinstance(self._on_exit, list) else []

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """A future that is done when the program has ended and is not started again."""
        return self._completed

    # The start

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Start the program, and register the event handlers that control it."""
        if self._details is not None:
            raise RuntimeError(f"ExecuteLocal action '{self.final_name}': executed more than once")
        prepared = self.prepare_command(context)
        if prepared is None or context.is_shutdown:
            return None
        number = context.global_values[_COUNT] = context.global_values.get(_COUNT, 0) + 1
        self._details = {
            "action": self,
            "name": f"{prepared.name}-{number}",
            "cmd": prepared.shown,
            "cwd": prepared.cwd,
            "env": prepared.env,
        }
        self._timeouts_now = [self._seconds(context, *each) for each in self._timeouts]
        self._targets = self._output_targets(context)
        self._check_output_format()
        self._has_terminal = self._wants_terminal(context)
        self._respawns = bool(perform_typed_substitution(context, self._respawn, bool))
        self._delay = self._number(context, "respawn_delay", self._respawn_delay or 0.0, float)
        self._retries_left = self._number(
            context, "respawn_max_retries", self._respawn_max_retries, int
        )
        self._completed = asyncio.get_running_loop().create_future()
        if self._on_exit is not None:
            context.register_event_handler(OnProcessExit(target_action=self, on_exit=self._on_exit))
        context.register_event_handler(_Requests(self))
        self._spawn(self._run(context, prepared))
        return None

    def _seconds(
        self, context: LaunchContext, name: str, given: SomeSubstitutionsType | None
    ) -> float:
        if given is None:
            given = context.launch_configurations.get(name, "5")
        return float(self._number(context, name, given, float))

    def _number(self, context: LaunchContext, name: str, given: Any, kind: type) -> Any:
        try:
            found = perform_typed_substitution(context, given, kind)
        except ValueError as error:
            raise ValueError(f"{name}: expected a number: {error}") from None
        if not isinstance(found, (int, float)):
            raise TypeError(f"{name}: expected a number, got {given!r}")
        return found

    def _check_output_format(self) -> None:
        try:
            self._output_format.format(line="", this=self)
        except (AttributeError, IndexError, KeyError, ValueError) as error:
            raise ValueError(
                "output_format: expected a format with {line} and {this}, got"
                f" {self._output_format!r}: {type(error).__name__}: {error}"
            ) from None

    def _output_targets(self, context: LaunchContext) -> dict[str, set[str]]:
        override = context.environment.get("OVERRIDE_LAUNCH_PROCESS_OUTPUT")
        output = override or self._output
        return output_targets(output if isinstance(output, dict) else perform(context, output))

    def _wants_terminal(self, context: LaunchContext) -> bool:
        given = context.launch_configurations.get("emulate_tty", self._emulate_tty)
        if isinstance(given, bool):
            return given
        return evaluate_condition_expression(context, normalize_to_list_of_substitutions(given))

    def _spawn(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, context: LaunchContext, prepared: PreparedCommand) -> None:
        try:
            while await self._run_once(context, prepared):
                pass
        except Exception as error:
            self._complete(error)
        finally:
            self._complete()

    def _complete(self, error: Exception | None = None) -> None:
        """Let the launch go on without the program; an error ends the launch."""
        self._started.set()
        assert self._completed is not None
        if self._completed.done():
            return
        if error is None:
            self._completed.set_result(None)
        else:
            remember_location(error, self._location)
            self._completed.set_exception(error)

    async def _run_once(self, context: LaunchContext, prepared: PreparedCommand) -> bool:
        """Run the program to its end; returns whether to start it again."""
        assert self._details is not None
        logger = get_logger(self.final_name)
        shown = " ".join(prepared.shown)
        if self._log_cmd:
            logger.info(
                f"process details: cmd='{shown}', cwd='{prepared.cwd}',"
                f" custom_env?={prepared.env is not None}"
            )
        if self._ends.is_set():
            return False
        try:
            self._tree = tree = await ProcessTree.start(
                prepared.command,
                lambda stream, data: self._received(context, stream, data),
                cwd=prepared.cwd,
                env=prepared.env,
                has_terminal=self._has_terminal,
            )
        except (OSError, ValueError) as error:  # ValueError: a word contains a null character
            where = f" in {prepared.cwd}" if prepared.cwd else ""
            first = prepared.shown[0]
            reason = os_errors.reason_of(error) if isinstance(error, OSError) else str(error)
            if isinstance(error, FileNotFoundError) and " " in first:
                reason += " (each word of a command is an item of `cmd`, without `shell=True`)"
            logger.error(f"cannot start '{first}'{where}: {reason}; the other programs continue")
            return False
        self._started.set()
        context.at_end.append(tree.end_descendants)
        self._details["pid"] = tree.pid
        logger.info(f"process started with pid [{tree.pid}]")
        context.emit_event_sync(ProcessStarted(**self._details))
        code = await tree.wait()
        self._flush()
        if not tree.has_processes():
            # A program may end often, and the system uses the number of its group again.
            context.at_end.remove(tree.end_descendants)
        if code == 0:
            logger.info(f"process has finished cleanly [pid {tree.pid}]")
        else:
            logger.error(f"process has died [pid {tree.pid}, exit code {code}, cmd '{shown}'].")
        context.emit_event_sync(ProcessExited(returncode=code, **self._details))
        return await self._starts_again(context)

    async def _starts_again(self, context: LaunchContext) -> bool:
        if not self._respawns or self._retries_left == 0:
            return False
        self._retries_left -= 1
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._ends.wait(), self._delay)
        return not self._ends.is_set() and not context.is_shutdown

    # Output

    def _received(self, context: LaunchContext, stream: int, data: bytes) -> None:
        assert self._details is not None
        context.emit_event_sync(_KINDS[stream](text=data, **self._details))
        begun = self._begun.setdefault(stream, bytearray())
        begun += data
        if b"\n" in data or len(begun) > _LONGEST_LINE:
            *lines, rest = bytes(begun).split(b"\n")
            if len(rest) > _LONGEST_LINE:
                lines, rest = [*lines, rest], b""
            begun[:] = rest
            for line in lines:
                self._print(stream, line)
        if self._cached_output:
            self._cached[stream].append(data.decode(errors="replace"))

    def _flush(self) -> None:
        for stream, rest in self._begun.items():
            if rest:
                self._print(stream, bytes(rest))
        self._begun.clear()

    def _print(self, stream: int, line: bytes) -> None:
        text = line.decode(errors="replace").removesuffix("\r")
        shown = self._output_format.format(line=text, this=self)
        name = _STREAMS[stream]
        for target in sorted(self._targets[name]):
            is_own = target == "own_log"
            launch_config.write(f"{self.final_name}-{name}" if is_own else target, shown)

    # The end

    def signal(self, number: int, name: str) -> None:
        """Send the program a signal, and log it."""
        if self._tree is None or self._tree.returncode is not None:
            return
        get_logger(self.final_name).info(f"sending signal '{name}' to process[{self.final_name}]")
        if name == "SIGKILL":
            self._tree.kill()
        else:
            self._tree.send_signal(number)

    def shutdown(self, *, is_interrupt: bool = False) -> None:
        """End the program: send SIGINT, later SIGTERM, later SIGKILL.

        Args:
            is_interrupt: Ctrl-C is the reason; the signal is not worth a line.
        """
        if not self._ends.is_set() and self._completed is not None and not self._completed.done():
            self._ends.set()
            self._spawn(self._escalate(is_interrupt))

    async def _escalate(self, is_interrupt: bool) -> None:
        await self._started.wait()
        if is_interrupt and self._tree is not None:
            # The terminal's Ctrl-C does not reach the program, which has a group of its own.
            self._tree.send_signal(signal.SIGINT)
        else:
            self.signal(signal.SIGINT, "SIGINT")
        previous, waited = "SIGINT", 0.0
        for name, seconds in zip(("SIGTERM", "SIGKILL"), self._timeouts_now, strict=True):
            assert self._completed is not None
            await asyncio.wait([self._completed], timeout=seconds)
            if self._completed.done():
                return
            waited += seconds
            get_logger(self.final_name).error(
                f"process[{self.final_name}] failed to terminate '{waited:g}' seconds after"
                f" receiving '{previous}', escalating to '{name}'"
            )
            self.signal(signal.SIGTERM, name)
            previous = name


class _Requests(BaseEventHandler):
    """Passes events that are requests to a program to the action of this program."""

    def __init__(self, action: ExecuteLocal) -> None:
        super().__init__(matcher=self._wants)
        self._action = action

    def _wants(self, event: Event) -> bool:
        if isinstance(event, (ShutdownProcess, SignalProcess)):
            return event.process_matcher(self._action)
        return isinstance(event, Shutdown)

    def handle(self, event: Event, context: LaunchContext) -> None:
        """Carry out the request."""
        super().handle(event, context)
        if isinstance(event, SignalProcess):
            self._action.signal(event.signal, event.signal_name)
        elif isinstance(event, Shutdown):
            self._action.shutdown(is_interrupt=event.due_to_sigint)
        else:
            self._action.shutdown()


def texts_of(context: LaunchContext, values: Any) -> list[str]:
    """Compute each of several texts."""
    return [
        perform_substitutions(context, normalize_to_list_of_substitutions(each)) for each in values
    ]
