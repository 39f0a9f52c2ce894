"""Groups, timers, functions, events and log lines, in virtual time."""

import asyncio
import os
from types import SimpleNamespace

import pytest


@pytest.fixture
def n(launch):
    return SimpleNamespace(**{**vars(launch.actions), **vars(launch.substitutions)})


def said(lines):
    return [line.partition("]: ")[2] for line in lines]


async def test_scope_of_a_group_ends_with_it(n, play):
    change = [n.SetLaunchConfiguration("a", "in"), n.SetEnvironmentVariable("LAUNCH_T", "in")]
    show = n.LogInfo(
        msg=[n.LaunchConfiguration("a"), n.EnvironmentVariable("LAUNCH_T", default_value="-")]
    )
    _, lines = await play(n.GroupAction([*change, show]), show, a="out")
    assert said(lines) == ["inin", "out-"]
    _, lines = await play(n.GroupAction(change, scoped=False), show, a="out")
    assert said(lines) == ["inin"]
    os.environ.pop("LAUNCH_T", None)


async def test_group_without_forwarding_sees_only_its_own_configurations(n, play):
    show = n.LogInfo(msg=[n.LaunchConfiguration("a", default="-"), n.LaunchConfiguration("b")])
    group = n.GroupAction(
        [show], forwarding=False, launch_configurations={"b": n.LaunchConfiguration("a")}
    )
    _, lines = await play(group, a="1")
    assert said(lines) == ["-1"]


async def test_timer_executes_later_and_keeps_the_order(n, play):
    loop = asyncio.get_running_loop()
    times = []
    see = n.OpaqueFunction(function=lambda _: times.append(loop.time() - start))
    start = loop.time()
    await play(
        n.TimerAction(period=3.0, actions=[see]), n.TimerAction(period=["1", ".5"], actions=[see])
    )
    assert times == [1.5, 3.0]


async def test_shutdown_cancels_timers(n, play):
    _, lines = await play(
        n.TimerAction(period=100.0, actions=[n.LogInfo(msg="late")]),
        n.TimerAction(period=1.0, actions=[n.Shutdown(reason="enough")]),
    )
    assert lines == []


async def test_function_gets_the_context_and_returns_actions(n, play):
    def build(context, first, second):
        return [n.LogInfo(msg=first + second + context.launch_configurations["a"])]

    action = n.OpaqueFunction(function=build, args=["1"], kwargs={"second": "2"})
    assert said((await play(action, a="3"))[1]) == ["123"]
    code, (line,) = await play(n.OpaqueFunction(function=lambda context: "text"))
    assert code == 1
    assert "expected a LaunchDescriptionEntity, got 'text'" in line
    with pytest.raises(TypeError, match="expected a callable"):
        n.OpaqueFunction(function=5)


async def test_coroutine_runs_beside_the_launch_and_ends_with_it(n, play):
    async def work(context):
        context.emit_event_sync  # noqa: B018 - the context is there
        await asyncio.sleep(1000)

    await play(n.OpaqueCoroutine(coroutine=work), n.TimerAction(period=1.0, actions=[n.Shutdown()]))
    assert asyncio.get_running_loop().time() < 500


async def test_log_lines_have_levels(n, play):
    _, lines = await play(n.LogWarning(msg="a"), n.Log(msg="b", level="error"), n.LogDebug(msg="c"))
    assert lines == ["[WARNING] [launch.user]: a", "[ERROR] [launch.user]: b"]


async def test_loops_create_actions(n, play):
    _, lines = await play(
        n.ForLoop(n.LaunchConfiguration("n"), function=lambda i: [n.LogInfo(msg=str(i))]),
        n.ForEach("{name: a};{name: b}", function=lambda name: [n.LogInfo(msg=name)]),
        n="2",
    )
    assert said(lines) == ["0", "1", "a", "b"]


async def test_handlers_are_registered_and_removed(launch, n, play):
    class Ping(launch.Event):
        name = "ping"

    handler = launch.EventHandler(
        matcher=lambda event: isinstance(event, Ping), entities=[n.LogInfo(msg="pong")]
    )
    _, lines = await play(
        n.RegisterEventHandler(handler),
        n.EmitEvent(event=Ping()),
        n.TimerAction(period=1.0, actions=[n.UnregisterEventHandler(handler)]),
        n.TimerAction(period=2.0, actions=[n.EmitEvent(event=Ping())]),
    )
    assert said(lines) == ["pong"]
