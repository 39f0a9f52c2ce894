"""The clocks of programs show virtual time."""

import pytest

pytestmark = pytest.mark.real_time


def test_all_clocks_move_with_the_sleep(simulated):
    code = """
        import time
        names = ["time", "monotonic", "perf_counter", "process_time", "thread_time"]
        before = [getattr(time, name)() for name in names]
        before_ns = [getattr(time, name + "_ns")() for name in names]
        time.sleep(1000)
        print([round(getattr(time, name)() - was, 2) for name, was in zip(names, before)])
        after = [getattr(time, name + "_ns")() for name in names]
        print([round((now - was) / 1e9, 2) for now, was in zip(after, before_ns)])
        """
    lines = simulated(a=code, duration=2000).run().lines["a"]
    assert lines == [str([1000.0] * 5)] * 2


def test_run_begins_on_the_first_day_of_2026(simulated):
    code = """
        import time, datetime
        from datetime import datetime as moment, timezone, date
        print(time.gmtime().tm_year, time.strftime("%Y-%m-%d", time.gmtime()), time.strftime("%Y"))
        print(moment.now(timezone.utc).date(), datetime.datetime.now().year, moment.today().year)
        print(date.today().year, time.localtime().tm_year, time.ctime()[-4:])
        one = moment.now()
        time.sleep(90)
        print(round((moment.now() - one).total_seconds(), 2))
        print(isinstance(one, moment), type(one - one), moment(2020, 1, 2) < one)
        """
    lines = simulated(a=code, duration=100).run().lines["a"]
    assert lines == [
        "2026 2026-01-01 2026",
        "2026-01-01 2026 2026",
        "2026 2026 2026",
        "90.0",
        "True <class 'datetime.timedelta'> True",
    ]


def test_wrong_clock_is_that_of_taskrpc_too(simulated):
    code = """
        import asyncio, time
        from taskrpc.spi import time_of_day
        async def main():
            for _ in range(20):
                print(time_of_day() - time.time())
                await asyncio.sleep(1.0)
        asyncio.run(main())
        """
    loaded = simulated("scenario.faults(wrong_clock=('a',))", a=code)
    assert loaded.search(*range(4)).coverage.faults["wrong clock"] > 0
    lines = [line for seed in range(4) for line in loaded.run(seed).lines["a"]]
    assert all(abs(float(line)) < 1e-5 for line in lines)


def test_program_with_a_file_of_accounts_runs(simulated):
    code = """
        import asyncio, json, os, taskrpc
        rows = {"ada": {"secret": "secret-of-the-user", "role": "operate"}}
        with open(os.open("accounts.json", os.O_WRONLY | os.O_CREAT, 0o600), "w") as file:
            json.dump({"accounts": rows}, file)
        async def main():
            async with taskrpc.Node("robot", accounts="accounts.json"):
                print("runs")
        asyncio.run(main())
        """
    assert simulated(a=code).run().lines["a"] == ["runs"]


def test_loop_that_polls_the_clock_sees_it_move(simulated):
    code = """
        import time
        end = time.time() + 1.0
        while time.time() < end:
            pass
        print("done", round(time.monotonic() - 1000, 0) <= 3)
        """
    assert simulated(a=code).run().lines["a"] == ["done True"]


def test_negative_sleep_is_an_error(simulated):
    code = """
        import time
        try:
            time.sleep(-1)
        except ValueError as error:
            print(error)
        """
    assert simulated(a=code).run().lines["a"] == ["sleep length must be non-negative"]


def test_clock_imported_by_name_is_virtual(simulated):
    code = """
        from time import monotonic, sleep, time
        begin, wall = monotonic(), time()
        sleep(5)
        print(round(monotonic() - begin, 2), round(time() - wall, 2))
        """
    assert simulated(a=code).run().lines["a"] == ["5.0 5.0"]


def test_log_records_have_virtual_times(simulated):
    code = """
        import logging, time
        logging.basicConfig(format="%(asctime)s %(message)s", datefmt="%Y")
        time.sleep(1)
        logging.warning("late")
        """
    assert simulated(a=code).run().lines["a"] == ["2026 late"]


def test_clocks_of_ros_are_virtual(simulated):
    code = """
        import rclpy
        rclpy.init()
        node = rclpy.create_node("a")
        begin = node.get_clock().now()
        rate = 0
        def tick():
            global rate
            rate += 1
        node.create_timer(0.5, tick)
        while rate < 10:
            rclpy.spin_once(node)
        taken = (node.get_clock().now() - begin).nanoseconds
        print(round(taken / 1e9, 1), begin.nanoseconds // 10**17)
        """
    assert simulated(a=code).run().lines["a"] == ["5.0 17"]
