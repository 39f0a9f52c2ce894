"""Programs that a launch starts: their output, their end, and their signals."""

import os
import signal
import sys

import pytest

pytestmark = pytest.mark.real_time

NO_SIGNALS = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.fixture
def python(launch):
    def python(code, *arguments, **options):
        options.setdefault("output", "screen")
        cmd = [sys.executable, "-c", code, *arguments]
        return launch.actions.ExecuteProcess(cmd=cmd, name="p", **options)

    return python


async def test_output_has_the_programs_name_in_front(python, play):
    code = "import sys; print('a\\nb'); print('c', end='', file=sys.stderr)"
    status, lines = await play(python(code))
    assert status == 0
    assert lines[0].startswith("[INFO] [p-1]: process started with pid [")
    assert sorted(lines[1:4]) == ["[p-1] a", "[p-1] b", "[p-1] c"]
    assert lines[4].startswith("[INFO] [p-1]: process has finished cleanly [pid ")


async def test_exit_code_and_command_of_a_failed_program_are_shown(python, play):
    _, lines = await play(python("import sys; sys.exit(4)", "x"))
    assert lines[-1].startswith("[ERROR] [p-1]: process has died [pid ")
    assert lines[-1].endswith(
        f", exit code 4, cmd '{sys.executable} -c import sys; sys.exit(4) x']."
    )


async def test_output_log_shows_only_errors_and_keeps_all(python, play, tmp_path):
    _, lines = await play(
        python("import sys; print('quiet'); print('loud', file=sys.stderr)", output="log")
    )
    assert "[p-1] loud" in lines
    assert "[p-1] quiet" not in lines
    (log,) = tmp_path.glob("log/*/launch.log")
    assert "[p-1] quiet\n" in log.read_text()


async def test_cached_output_is_available(python, play):
    action = python("print('kept')", cached_output=True, output="own_log")
    await play(action)
    assert action.get_stdout().split() == ["kept"]
    assert action.return_code == 0
    with pytest.raises(RuntimeError, match="cached output must be true"):
        python("pass").get_stderr()


async def test_program_that_does_not_exist_is_one_line_and_the_rest_starts(launch, python, play):
    missing = launch.actions.ExecuteProcess(cmd=["no-such-program-9"])
    code, lines = await play(missing, python("print('here')"))
    assert code == 0
    assert lines[0] == (
        "[ERROR] [no-such-program-9-1]: cannot start 'no-such-program-9':"
        " No such file or directory; the other programs continue"
    )
    assert "[p-2] here" in lines


async def test_program_is_started_again_as_often_as_allowed(python, play):
    _, lines = await play(
        python("print('up')", respawn=True, respawn_delay=0.01, respawn_max_retries=2)
    )
    assert lines.count("[p-1] up") == 3


@NO_SIGNALS
async def test_program_that_ignores_signals_is_killed_in_three_steps(launch, python, play):
    stubborn = (
        "import signal, time\n"
        "for number in (signal.SIGINT, signal.SIGTERM): signal.signal(number, signal.SIG_IGN)\n"
        "print('ready', flush=True)\ntime.sleep(600)\n"
    )
    action = python(stubborn, sigterm_timeout="0.1", sigkill_timeout="0.2")
    handlers, shutdown = launch.event_handlers, launch.actions.Shutdown()
    context = []
    ready = handlers.OnProcessIO(
        target_action=action,
        on_stdout=lambda event: context or context.append(event) or shutdown,
    )
    _, lines = await play(launch.actions.RegisterEventHandler(ready), action)
    steps = [line for line in lines if "process[p-1]" in line]
    assert steps == [
        "[INFO] [p-1]: sending signal 'SIGINT' to process[p-1]",
        "[ERROR] [p-1]: process[p-1] failed to terminate '0.1' seconds after receiving 'SIGINT',"
        " escalating to 'SIGTERM'",
        "[INFO] [p-1]: sending signal 'SIGTERM' to process[p-1]",
        "[ERROR] [p-1]: process[p-1] failed to terminate '0.3' seconds after receiving 'SIGTERM',"
        " escalating to 'SIGKILL'",
        "[INFO] [p-1]: sending signal 'SIGKILL' to process[p-1]",
    ]
    assert any("exit code -9" in line for line in lines)


@NO_SIGNALS
async def test_signal_is_sent_to_the_chosen_program(launch, python, play):
    action = python("import time; print('ready', flush=True); time.sleep(600)")
    send = launch.actions.EmitEvent(
        event=launch.events.process.SignalProcess(
            signal_number=signal.SIGUSR1,
            process_matcher=launch.events.process.matches_action(action),
        )
    )
    ready = launch.event_handlers.OnProcessIO(target_action=action, on_stdout=lambda event: send)
    _, lines = await play(launch.actions.RegisterEventHandler(ready), action)
    assert f"exit code -{int(signal.SIGUSR1)}" in lines[-1]


@NO_SIGNALS
async def test_program_with_a_terminal_sees_one(python, play):
    action = python("import sys; print(sys.stdout.isatty())", emulate_tty=True)
    _, lines = await play(action)
    assert "[p-1] True" in lines


async def test_working_directory_and_variables_reach_the_program(python, play, tmp_path):
    code = "import os; print(os.path.samefile('.', os.environ['PLACE']), os.environ['NUMBER'])"
    variables = {"PLACE": str(tmp_path), "NUMBER": 5}
    _, lines = await play(python(code, cwd=str(tmp_path), additional_env=variables))
    assert "[p-1] True 5" in lines


async def test_action_starts_only_once(python, play):
    action = python("pass")
    code, lines = await play(action, action)
    assert code == 1
    assert any("executed more than once" in line for line in lines)


@pytest.mark.skipif(os.name != "posix", reason="the line is one for sh")
async def test_shell_executes_the_whole_line(launch, play):
    line = launch.actions.ExecuteProcess(
        cmd=[["echo a", "b"], "&& echo $((1 + 1))"], shell=True, output="screen"
    )
    _, lines = await play(line)
    assert lines[1:3] == ["[echo-1] ab", "[echo-1] 2"]


async def test_prefix_is_put_in_front_of_matching_programs(launch, play):
    prefix = f"'{sys.executable}' -c 'import sys; print(sys.argv[1:])'"
    action = launch.actions.ExecuteProcess(cmd=["tool", "x"], output="screen")
    _, lines = await play(action, **{"launch-prefix": prefix, "launch-prefix-filter": "to"})
    assert "[tool-1] ['tool', 'x']" in lines
    _, lines = await play(
        launch.actions.ExecuteProcess(cmd=["no-such-9"]),
        **{"launch-prefix": prefix, "launch-prefix-filter": "to"},
    )
    assert "cannot start 'no-such-9'" in lines[0]


async def test_command_that_cannot_start_is_one_line(launch, play):
    first = launch.actions.ExecuteProcess(cmd=["echo", "a\0b"])
    code, lines = await play(first, launch.actions.ExecuteProcess(cmd="no such program"))
    assert code == 0
    assert lines[0].startswith("[ERROR] [echo-1]: cannot start 'echo': embedded null ")
    assert "(each word of a command is an item of `cmd`, without `shell=True`);" in lines[1]


async def test_ended_program_is_not_ended_again(launch):
    service = launch.LaunchService()
    action = launch.actions.ExecuteProcess(
        cmd=[sys.executable, "-c", ""], respawn=True, respawn_max_retries=1
    )
    service.include_launch_description(launch.LaunchDescription([action]))
    assert await service.run_async() == 0
    assert service.context.at_end == []


async def test_output_without_line_ends_is_printed_in_pieces(python, play):
    size = 3 * 2**20
    _, lines = await play(python(f"import sys; sys.stdout.write('x' * {size})"))
    assert sum(line.count("x") for line in lines if line.startswith("[p-1] ")) == size
    assert max(map(len, lines)) < 2**21
