"""Event handlers execute entities when a program starts, writes or ends."""

import sys
from types import SimpleNamespace

import pytest

pytestmark = pytest.mark.real_time


@pytest.fixture
def n(launch):
    return SimpleNamespace(**{**vars(launch.event_handlers), **vars(launch.actions)})


def python(n, code, **options):
    return n.ExecuteProcess(cmd=[sys.executable, "-c", code], name="p", **options)


async def test_start_output_and_end_of_a_program_are_handled(launch, play, n):
    program = python(n, "import sys; print('ready'); sys.exit(3)")
    value = launch.substitutions.LocalSubstitution
    said = []
    code, lines = await play(
        n.RegisterEventHandler(
            n.OnProcessStart(target_action=program, on_start=[n.LogInfo(msg="started")])
        ),
        n.RegisterEventHandler(
            n.OnProcessIO(target_action=program, on_stdout=lambda event: said.append(event.text))
        ),
        n.RegisterEventHandler(
            n.OnProcessExit(
                target_action=program,
                on_exit=[n.LogInfo(msg=["code ", value("event.returncode")])],
            )
        ),
        program,
    )
    assert code == 0
    assert b"".join(said).split() == [b"ready"]
    user = [line for line in lines if line.startswith("[INFO] [launch.user]")]
    assert user == ["[INFO] [launch.user]: started", "[INFO] [launch.user]: code 3"]


async def test_next_program_starts_when_one_has_ended(play, n):
    first = python(n, "print('one')", output="screen")
    second = python(n, "print('two')", output="screen")
    _, lines = await play(
        first,
        n.RegisterEventHandler(n.OnProcessExit(target_action=first, on_exit=lambda *_: [second])),
    )
    assert [line for line in lines if line.startswith("[p-")] == ["[p-1] one", "[p-2] two"]


async def test_end_of_a_required_program_ends_the_others(play, n):
    _, lines = await play(
        python(n, "pass", on_exit=n.Shutdown()),
        python(n, "import time; time.sleep(600)"),
        n.RegisterEventHandler(n.OnShutdown(on_shutdown=[n.LogInfo(msg="bye")])),
    )
    assert "[INFO] [launch]: process[p-1] was required: shutting down launched system" in lines
    assert "[INFO] [launch.user]: bye" in lines
    assert "[INFO] [p-2]: sending signal 'SIGINT' to process[p-2]" in lines


async def test_end_of_an_action_is_handled(play, n):
    timer = n.TimerAction(period=0.01, actions=[])
    done = n.OnExecutionComplete(target_action=timer, on_completion=[n.LogInfo(msg="over")])
    _, lines = await play(n.RegisterEventHandler(done), timer)
    assert lines == ["[INFO] [launch.user]: over"]


async def test_target_must_be_an_action(n):
    with pytest.raises(TypeError, match="requires a 'target_action' argument"):
        n.OnProcessExit(target_action=5, on_exit=[])
