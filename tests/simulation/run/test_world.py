"""Checks of a scenario ask the world about a run."""

import pytest

from tests.simulation.small_programs import CLIENT, ROBOT, ROS_CLIENT, ROS_ROBOT

pytestmark = pytest.mark.real_time
TALKER = """
    import time
    import rclpy
    from std_msgs.msg import String
    rclpy.init()
    node = rclpy.create_node("talker")
    publisher = node.create_publisher(String, "chatter", 10)
    message = String()
    for number in range(3):
        time.sleep(1)
        message.data = f"word {number}"
        publisher.publish(message)
    print("done")
    """
ASYNC_TALKER = """
    import asyncio, srvgen, taskrpc
    String = srvgen.load("std_msgs/msg/String")
    async def main():
        async with taskrpc.Node("talker") as node:
            publisher = node.create_publisher(String, "chatter")
            message = String()
            for number in range(3):
                message.data = f"word {number}"
                publisher.publish(message)
                await asyncio.sleep(1)
    asyncio.run(main())
    """


def test_calls_are_counted_by_their_end(simulated):
    loaded = simulated(
        """
        scenario.faults(lose_requests=1.0)

        @scenario.finally_
        def counted(world):
            assert world.calls("/pick") == world.calls("pick") == 3
            assert world.calls("/pick", ok=True) == 0
            assert world.calls("/pick", ok=False) == 3
            assert world.calls("/other") == 0
        """,
        robot=ROBOT,
        client=CLIENT,
    )
    assert loaded.run().lines["client"] == [f"failed {n} DeadlineExceeded" for n in range(3)]


@pytest.mark.parametrize("programs", [(ROBOT, CLIENT), (ROS_ROBOT, ROS_CLIENT)])
def test_calls_with_a_response_are_ok(simulated, programs):
    loaded = simulated(
        """
        @scenario.finally_
        def counted(world):
            assert world.calls("/pick", ok=True) == world.calls("/pick") == 3
            assert world.calls("/pick", ok=False) == 0
            assert world.count("robot", "picked") == 3
        """,
        robot=programs[0],
        client=programs[1],
    )
    loaded.run()


def test_lines_are_those_that_a_program_printed_or_logged(simulated):
    loaded = simulated(
        """
        @scenario.always
        def seen_at_once(world):
            assert world.count("a", "printed") >= world.count("a", "logged")

        @scenario.finally_
        def all_seen(world):
            assert [line.rpartition(" ")[2] for line in world.lines("a")] == ["printed", "logged"]
        """,
        a="""
        import rclpy
        rclpy.init()
        print("printed")
        rclpy.create_node("a").get_logger().warning("logged")
        """,
    )
    loaded.run()


@pytest.mark.parametrize("talker", [TALKER, ASYNC_TALKER])
def test_messages_are_those_that_were_published(simulated, talker):
    loaded = simulated(
        """
        @scenario.always
        def in_order(world):
            words = [message.data for message in world.messages("chatter")]
            assert words == [f"word {number}" for number in range(len(words))], words

        @scenario.finally_
        def all_of_them(world):
            assert len(world.messages("/chatter")) == 3
            assert world.messages("/nothing") == []
        """,
        a=talker,
    )
    loaded.run()


def test_time_and_starts(simulated):
    loaded = simulated(
        """
        times = []

        @scenario.always
        def time_moves_on(world):
            times.append(world.time)
            assert times[-1] >= max(times) or times.clear()

        @scenario.finally_
        def at_the_end(world):
            assert 5 < world.time < 6
            assert world.starts("a") == 1
        """,
        a="import time; print(1); time.sleep(5); print(2)",
    )
    loaded.run()


@pytest.mark.parametrize("question", ["lines('b')", "count('b', 'x')", "starts('b')"])
def test_question_about_an_unknown_program_fails_the_check(simulated, question):
    loaded = simulated(
        f"""
        @scenario.always
        def about_b(world):
            assert not world.{question}
        """,
        a="print(1)",
    )
    failure = loaded.explain(loaded.search(0).failed)
    assert failure.kind == "about_b"
    assert "expected the name of a program (a), got 'b'" in failure.text


@pytest.mark.parametrize("robot", [ROBOT, ROS_ROBOT])
def test_final_check_can_call_a_service_without_faults(simulated, robot):
    loaded = simulated(
        """
        scenario.faults(lose_requests=1.0, lose_responses=1.0, delay=(5.0, 9.0))

        @scenario.finally_
        def answers(world):
            assert world.call("pick", a=3, b=4).sum == 7
            assert world.call("/pick", a=1).sum == 1
            assert world.calls("/pick") == 0  # those of the check do not count
        """,
        robot=robot,
    )
    loaded.run()


def test_call_of_a_service_that_nobody_offers_fails_the_check(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def answers(world):
            world.call("/pick", a=3)
        """,
        robot="print('ends')",
    )
    failure = loaded.explain()
    assert failure.kind == "answers"
    assert "no program offers /pick at the end of the run" in failure.text


def test_call_of_a_callback_that_hangs_fails_the_check(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def answers(world):
            world.call("/pick", a=3)
        """,
        robot=ROBOT.replace("def pick", "async def pick").replace(
            "response.sum =", "await asyncio.sleep(1000); response.sum ="
        ),
    )
    failure = loaded.explain()
    assert failure.kind == "answers"
    assert "/pick" in failure.text


def test_call_with_a_wrong_field_fails_the_check(simulated):
    loaded = simulated(
        """
        @scenario.finally_
        def answers(world):
            world.call("/pick", wrong=3)
        """,
        robot=ROBOT,
    )
    failure = loaded.explain()
    assert failure.kind == "answers"
    assert "wrong" in failure.text


def test_call_during_the_run_fails_the_check(simulated):
    loaded = simulated(
        """
        @scenario.always
        def answers(world):
            world.call("/pick", a=3)
        """,
        robot=ROBOT,
    )
    assert "only the functions of scenario.finally_ may call" in loaded.explain().text
