import asyncio


async def test_idle_robot_waits_for_more_tasks_before_it_claims_one(fleet):
    manager = await fleet.add("r1", settle=0.5)
    await asyncio.sleep(5)
    await manager.submit("move", "1", 2)
    await asyncio.sleep(0.3)
    await manager.submit("move", "2", 9)
    await fleet.until_done()
    assert [target for target, *_ in fleet.robots["r1"].runs] == ["2", "1"]


async def test_next_task_follows_without_a_wait(fleet):
    manager = await fleet.add("r1", settle=0.5)
    for _ in range(2):
        await manager.submit("move", "0", 5)
    await fleet.until_done()
    first, second = fleet.robots["r1"].runs
    assert second[1] == first[2]


async def test_robot_that_fails_makes_its_task_failed_and_goes_on(fleet):
    manager = await fleet.add("r1")
    fleet.robots["r1"].fail_with = OSError("the wheel is stuck")
    await manager.submit("move", "3", 5)
    await fleet.until_done()
    assert fleet.tasks()[1].message == "OSError: the wheel is stuck"
    fleet.robots["r1"].fail_with = None
    await manager.submit("move", "3", 5)
    await fleet.until_done()
    assert fleet.states() == {1: "FAILED", 2: "SUCCEEDED"}


async def test_lease_that_ends_between_a_claim_and_its_answer_starts_no_robot(fleet):
    manager = await fleet.add("r1")
    store, commit = manager.store, manager.store._commit

    async def answers_late(batch):
        """Answer a claim only when the lease has ended, as after SIGSTOP and SIGCONT."""
        result = await commit(batch)
        if store.state.begun:
            store._commit = commit
            await asyncio.sleep(7)
        return result

    store._commit = answers_late
    await manager.submit("move", "3", 5)
    await asyncio.sleep(10)
    assert fleet.robots["r1"].runs == []
    assert fleet.states() == {1: "INTERRUPTED"}
    assert manager.lease.is_valid


async def test_robot_that_does_not_halt_does_not_hold_the_server_up(fleet):
    manager = await fleet.add("r1")
    fleet.robots["r1"].ignores_cancel = True
    await manager.submit("move", "30", 5)
    await asyncio.sleep(1)
    response = await manager.cancel(1)
    assert response.message == "Task 1 is being cancelled"
    assert fleet.states() == {1: "CANCELING"}
    await manager.stop()
    await asyncio.sleep(2)
    assert fleet.states() == {1: "CANCELED"}


async def test_pause_at_another_server_halts_this_robot_and_resume_moves_it(fleet):
    first, second = [await fleet.add(f"r{n}", capabilities=c) for n, c in ((1, "move"), (2, "x"))]
    await first.submit("move", "5", 5)
    await asyncio.sleep(1)
    await second.pause()
    await asyncio.sleep(10)
    assert first.running.state.value == "PAUSED"
    await second.resume()
    await fleet.until_done()
    [run] = fleet.robots["r1"].runs
    assert run[2] > 10
