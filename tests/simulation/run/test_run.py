"""A run follows from its seed, and its faults happen."""

import os
import subprocess
import sys

import pytest

from taskrpc.simulation.run.seeds import VARIANT
from taskrpc.simulation.search.fault_words import fault_words
from tests.simulation.small_programs import CLIENT, ROBOT, ROS_CLIENT, ROS_ROBOT

pytestmark = pytest.mark.real_time
PAIRS = pytest.mark.parametrize("programs", [(ROBOT, CLIENT), (ROS_ROBOT, ROS_CLIENT)])
FAULTS = """
    scenario.faults(
        lose_requests=0.1, lose_responses=0.1, duplicate_requests=0.1, reorder_requests=0.1,
        busy=0.1, delay=(0.0, 0.2), partition=(0.5, 2.0), slow=("robot",), wrong_clock=("client",),
        crash=("robot",), restart=(0.5, 3.0),
    )
    """
CHANCY = """
    import os, random, uuid
    print(list({"ab", "cd", "ef"}), random.random(), uuid.uuid4(), os.getpid(), hash("text"))
    """
WAITING_ROBOT = """
    import time
    while True:
        time.sleep(0.5)
        print("tick")
    """


@PAIRS
def test_same_seed_has_the_same_hash_after_other_runs(simulated, programs):
    loaded = simulated(FAULTS, robot=programs[0], client=programs[1], chancy=CHANCY)
    first = loaded.hash_of(5)
    others = [loaded.hash_of(seed) for seed in range(6, 9)]
    assert loaded.hash_of(5) == first
    assert len({first, *others}) == 4


def hashes_in_another_process(file, seeds, hash_seed):
    """Run seeds in a new worker, with another PYTHONHASHSEED, in reverse order."""
    code = f"""
import os, sys
from pathlib import Path
from taskrpc.simulation.search.protocol import Load, Search
from taskrpc.simulation.search.worker import Worker

worker = Worker()
worker.answer(Load({str(file)!r}))
found = [worker.answer(Search([seed])).hash for seed in reversed({list(seeds)!r})]
sys.stdout.write("\\n".join(reversed(found)))
sys.stdout.flush()
os._exit(0)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return done.stdout.split()


@pytest.mark.faults
@PAIRS
def test_same_seed_has_the_same_hash_in_another_process(simulated, programs):
    loaded = simulated(FAULTS, robot=programs[0], client=programs[1])
    seeds = range(60)
    first = [loaded.hash_of(seed) for seed in seeds]
    assert hashes_in_another_process(loaded.file, seeds, 12345) == first


def test_variants_of_a_seed_keep_the_starts(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def fails(world):
            assert False
        """,
        duration=2,
        robot=ROBOT,
        client=CLIENT,
    )
    starts = []
    for seed in 5, 5 + VARIANT, 6:
        events = loaded.explain(seed).events
        starts.append([(e.time, e.program) for e in events if e.kind == "start"])
    # the order of the starts is left out of the story: it does not matter for this failure
    assert starts[0] == starts[1] == starts[2]


def test_programs_start_within_half_a_second_in_an_order_of_the_seed(simulated):
    code = "import time; print(round(time.monotonic() - 1000, 3))"
    loaded = simulated(a=code, b=code)
    outcomes = [loaded.run(seed).lines for seed in range(8)]
    moments = [[float(each[name][0]) for name in "ab"] for each in outcomes]
    assert all(0 <= each < 0.51 for both in moments for each in both)
    assert {a < b for a, b in moments} == {True, False}


@pytest.mark.parametrize(
    ("fault", "client_line", "picks"),
    [
        ("lose_requests=1.0", "failed 0 DeadlineExceeded", 0),
        ("lose_responses=1.0", "failed 0 DeadlineExceeded", 3),
        ("busy=1.0", "failed 0 ServerBusy", 0),
        ("duplicate_requests=1.0", "answer 0", 6),
        ("delay=(0.6, 0.7)", "failed 0 DeadlineExceeded", 3),
    ],
)
def test_faults_reach_the_programs(simulated, fault, client_line, picks):
    loaded = simulated(f"scenario.faults({fault})", robot=ROBOT, client=CLIENT)
    lines = loaded.run().lines
    assert lines["client"][0] == client_line
    assert len(lines["robot"]) == picks


def test_shares_lose_some_requests_and_responses(simulated):
    loaded = simulated(
        "scenario.faults(lose_requests=0.2, lose_responses=0.2)", robot=ROBOT, client=CLIENT
    )
    faults = loaded.search(*range(10)).coverage.faults
    assert 0 < faults["lose request"] < 20
    assert 0 < faults["lose response"] < 20


def test_delays_are_within_their_range(simulated):
    loaded = simulated(
        "scenario.faults(delay=(0.1, 0.2))",
        robot=ROBOT,
        client=CLIENT.replace("response =", "import time; b = time.time(); response =").replace(
            "response.sum)", "round(time.time() - b, 2))"
        ),
    )
    for seed in range(3):
        for line in loaded.run(seed).lines["client"]:
            assert 0.2 <= float(line.split()[1]) <= 0.41


def test_programs_connect_although_their_calls_take_long(simulated):
    patient = CLIENT.replace("timeout=1.0", "timeout=20.0")
    assert patient != CLIENT
    loaded = simulated("scenario.faults(delay=(2.0, 3.0))", robot=ROBOT, client=patient)
    for seed in range(3):
        outcome = loaded.run(seed)
        assert [each.split()[0] for each in outcome.lines["client"]] == ["answer"] * 3
        assert outcome.time > 3 * 2 * 2.0


def test_killed_program_starts_again_within_the_range(simulated):
    loaded = simulated(
        "scenario.faults(crash=('robot',), restart=(2.0, 3.0))", duration=20, robot=WAITING_ROBOT
    )
    starts = [loaded.run(seed).starts["robot"] for seed in range(6)]
    assert set(starts) <= {1, 2, 3}
    assert max(starts) > 1


def test_killed_program_without_restart_stays_away(simulated):
    loaded = simulated("scenario.faults(crash=('robot',))", duration=20, robot=WAITING_ROBOT)
    outcomes = [loaded.run(seed) for seed in range(6)]
    assert {each.starts["robot"] for each in outcomes} == {1}
    assert min(len(each.lines["robot"]) for each in outcomes) < 35


def test_run_ends_with_its_programs_or_after_its_duration(simulated):
    assert simulated(a="print(1)").run().time < 1
    assert simulated(a=WAITING_ROBOT, duration=20).run().time == 20


def test_check_after_each_step_fails_with_its_line(simulated):
    loaded = simulated(
        """
        @scenario.always
        def few(world):
            assert world.count("a", "line") < 3, "too many"
        """,
        a="for number in range(9): print('line', number)",
    )
    failure = loaded.explain()
    assert failure.kind == "few"
    assert "too many" in failure.text
    assert 'world.count("a", "line") < 3' in failure.text


def test_check_that_raises_another_exception_fails_with_a_traceback(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def broken(world):
            world.unknown()
        """,
        a="pass",
    )
    failure = loaded.explain()
    assert failure.kind == "broken"
    assert "AttributeError" in failure.text
    assert "small.sim.py" in failure.text


def test_programs_in_other_domains_do_not_meet(simulated):
    other = """
    import os
    os.environ["ROS_DOMAIN_ID"] = "5"
    """
    loaded = simulated(
        robot=ROBOT, client=other + CLIENT.replace("service(None)", "service(5.0)"), duration=20
    )
    assert "answer 0" not in loaded.run().lines["client"]


def test_domain_of_the_environment_is_one_network(simulated):
    other = """
    import os
    os.environ["ROS_DOMAIN_ID"] = "5"
    """
    loaded = simulated(robot=other + ROBOT, client=other + CLIENT)
    assert loaded.run().lines["client"] == ["answer 0", "answer 1", "answer 2"]


def test_end_of_a_killed_program_that_leaves_the_simulated_world_is_not_refused(simulated):
    loaded = simulated(
        duration=5,
        a="""
        import socket, time
        try:
            time.sleep(100)
        finally:
            socket.socket()
        """,
    )
    assert loaded.run().lines["a"] == []


@pytest.mark.faults
def test_output_without_end_fails_the_run(simulated):
    loaded = simulated(
        duration=200,
        a="""
        import time
        while True:
            print("again")
            time.sleep(0)
        """,
    )
    assert loaded.explain().kind == "endless work"


def test_program_that_writes_without_end_fails_the_run_at_once(simulated):
    code = """
        while True:
            try:
                print("again and again")
            except Exception:
                pass
        """
    failure = simulated(a=code).explain()
    assert failure.kind == "endless output"
    assert failure.text == "a has written more than 1000000 characters"


def test_program_that_was_killed_shortly_before_the_end_is_up_again_for_the_final_checks(simulated):
    faults = "scenario.faults(crash=('robot',), restart=(2.0, 3.0))"
    check = """

@scenario.finally_
def robot_answers(world):
    world.call("pick")
"""
    loaded = simulated(faults + check, duration=2.0, robot=ROBOT, client=CLIENT)
    answer = loaded.search(*range(60))
    assert answer.failed is None
    assert answer.coverage.faults["kill"] > 0


PATIENT_CLIENT = """
    import asyncio, srvgen, taskrpc

    AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")

    async def main():
        async with taskrpc.Node("client") as node:
            client = node.create_client(AddTwoInts, "pick")
            await client.wait_for_service(None)
            for number in range(200):
                try:
                    await client.call(AddTwoInts.Request(a=number), timeout=1.0)
                    print("answer")
                except taskrpc.TaskRpcError as error:
                    print(type(error).__name__)
                await asyncio.sleep(0.1)

    asyncio.run(main())
    """


def test_connections_break_and_are_made_again(simulated):
    loaded = simulated("scenario.faults(cut=1.0)", robot=ROBOT, client=PATIENT_CLIENT)
    lines = [line for seed in range(5) for line in loaded.run(seed).lines["client"]]
    broken = loaded.search(*range(5)).coverage.faults["cut connection"]
    assert broken > 5
    assert 0 < lines.count("OutcomeUnknown") <= broken
    assert lines.count("answer") > 900


def test_story_says_which_connection_broke(simulated):
    loaded = simulated(
        """
        scenario.faults(cut=0.5)

        @scenario.always
        def nothing_is_lost(world):
            assert not world.count("client", "OutcomeUnknown")
        """,
        robot=ROBOT,
        client=PATIENT_CLIENT,
    )
    found = loaded.first_failure(20)
    assert [fault_words(each) for each in found.faults] == [
        "connection 1 of client with robot broken"
    ]


def test_no_fault_happens_after_the_end_of_the_faults(simulated):
    faults = """
        scenario.faults(
            lose_responses=0.5, cut=1.0, delay=(0.0, 0.1), crash=("robot",), restart=(0.1, 0.5),
            partition=(1.0, 3.0), until=5.0,
        )

        @scenario.finally_
        def faults_end(world):
            times = [each.time for each in world.faults() if "again" not in each.text]
            assert times
            assert max(times) <= 5.0, times
            assert world.lines("client")[-100:] == ["answer"] * 100
        """
    loaded = simulated(faults, robot=ROBOT, client=PATIENT_CLIENT)
    assert loaded.search(*range(15)).failed is None


def test_story_says_what_a_wrong_clock_does(simulated):
    loaded = simulated(
        """
        scenario.faults(wrong_clock=("program",))

        @scenario.always
        def time_goes_on(world):
            times = [float(each) for each in world.lines("program")]
            assert all(0 < later - earlier < 1.5 for earlier, later in zip(times, times[1:]))
        """,
        duration=20,
        program="import time\nwhile True:\n    print(time.time())\n    time.sleep(1.0)",
    )
    failed = loaded.search(*range(30)).failed
    words = [each.text for each in loaded.explain(failed).events if each.kind == "fault"]
    assert words[0] == "wrong clock program"
    assert "from" in words[1]
    assert words[1].startswith(("the time of day is ", "the time of day stands still "))
