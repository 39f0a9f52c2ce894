"""A program of a simulation has modules, variables, arguments, output and an end of its own."""

import pytest

from tests.simulation.small_programs import CLIENT, ROBOT

pytestmark = pytest.mark.real_time


def test_program_is_main_and_has_its_own_arguments(simulated):
    loaded = simulated(
        'scenario.program("b", "a.py", "--count", 5)',
        a="import sys; print(__name__, sys.argv[1:], __file__ == sys.argv[0])",
    )
    lines = loaded.run().lines
    assert lines == {"a": ["__main__ [] True"], "b": ["__main__ ['--count', '5'] True"]}


def test_modules_beside_a_program_belong_to_it_alone(simulated):
    code = """
        import sys, time
        import counter, parts.inner
        counter.value += 1
        time.sleep(1)
        import counter as again
        print(counter.value, again is counter, sys.modules["counter"] is counter)
        print(parts.inner.name, sys.modules["__main__"].__file__[-4:])
        """
    loaded = simulated(a=code, b=code)
    folder = loaded.file.parent
    (folder / "counter.py").write_text("value = 0\n")
    (folder / "parts").mkdir()
    (folder / "parts" / "__init__.py").write_text("")
    (folder / "parts" / "inner.py").write_text("name = __name__\n")
    lines = loaded.run().lines
    assert lines["a"] == ["1 True True", "parts.inner a.py"]
    assert lines["b"] == ["1 True True", "parts.inner b.py"]


def test_module_that_fails_while_it_is_imported_can_be_imported_again(simulated):
    loaded = simulated(
        a="""
        for _ in range(2):
            try:
                import broken
            except ZeroDivisionError:
                print("broken")
        """
    )
    (loaded.file.parent / "broken.py").write_text("1 / 0\n")
    assert loaded.run().lines["a"] == ["broken", "broken"]


def test_each_run_loads_the_modules_anew(simulated):
    loaded = simulated(a="import counter; counter.value += 1; print(counter.value)")
    (loaded.file.parent / "counter.py").write_text("value = 0\n")
    assert [loaded.run(seed).lines["a"] for seed in range(2)] == [["1"], ["1"]]


def test_programs_have_environments_of_their_own(simulated):
    code = """
        import os, time
        print(os.environ.get("ROBOT"), os.getenv("ROBOT"))
        os.environ["ROBOT"] = __file__[-4:]
        time.sleep(1)
        print(os.environ["ROBOT"])
        """
    loaded = simulated(a=code, b=code)
    for seed in range(2):
        lines = loaded.run(seed).lines
        assert lines == {"a": ["None None", "a.py"], "b": ["None None", "b.py"]}


def test_programs_have_loggers_of_their_own(simulated):
    code = """
        import logging, time
        logging.basicConfig(level=logging.{level}, format="%(levelname)s %(name)s %(message)s")
        time.sleep(1)
        logging.getLogger("part").info("information")
        logging.getLogger("part").warning("trouble")
        print(len(logging.getLogger().handlers))
        """
    loaded = simulated(a=code.format(level="INFO"), b=code.format(level="ERROR"))
    lines = loaded.run().lines
    assert lines["a"] == ["INFO part information", "WARNING part trouble", "1"]
    assert lines["b"] == ["1"]


def test_programs_draw_random_numbers_of_their_own(simulated):
    code = """
        import random, uuid, os, secrets, time
        first = random.random()
        time.sleep(1)
        print(first, random.randint(0, 10**9), random.choice("abcdefgh"), random.Random().random())
        print(uuid.uuid4(), os.urandom(4).hex(), secrets.token_hex(4))
        random.seed(5)
        print(random.random(), random.Random(5).random())
        """
    loaded = simulated(a=code, b=code)
    first, again, other = (loaded.run(seed).lines for seed in (1, 1, 2))
    assert first == again
    assert first["a"][:2] != first["b"][:2]
    assert first["a"][:2] != other["a"][:2]
    assert len(set(first["a"][2].split())) == 1


def test_thread_names_and_ids_are_those_of_a_new_process(simulated):
    code = """
        import os, threading
        thread = threading.Thread(target=lambda: print(threading.current_thread().name))
        thread.start()
        thread.join()
        own = threading.current_thread()
        print(own.name, threading.main_thread() is own)
        print(os.getpid() > 0, os.getpid() == os.getpid())
        """
    lines = simulated(a=code, b=code).run().lines
    assert lines["a"] == lines["b"] == ["Thread-1 (<lambda>)", "MainThread True", "True True"]


def test_process_ids_differ(simulated):
    code = "import os; print(os.getpid())"
    lines = simulated(a=code, b=code).run().lines
    assert lines["a"] != lines["b"]


def test_exit_runs_the_registered_functions_in_reverse(simulated):
    code = """
        import atexit, sys
        atexit.register(print, "first")
        atexit.register(print, "second")
        @atexit.register
        def never(): print("never")
        atexit.unregister(never)
        try:
            sys.exit("bad arguments")
        finally:
            print("finally")
        """
    loaded = simulated(a=code)
    assert loaded.run().lines["a"] == ["finally", "bad arguments", "second", "first"]


def test_output_without_a_last_newline_is_a_line(simulated):
    code = r"""
        import sys
        print("one", "two", end="")
        print("", flush=True)
        sys.stdout.write("three\nfo")
        sys.stderr.write("ur")
        """
    assert simulated(a=code).run().lines["a"] == ["one two", "three", "four"]


def test_program_ends_after_its_threads_that_are_no_daemons(simulated):
    code = """
        import threading, time
        def work(name, seconds):
            time.sleep(seconds)
            print(name)
        threading.Thread(target=work, args=("worker", 2)).start()
        threading.Thread(target=work, args=("daemon", 3), daemon=True).start()
        print("main")
        """
    outcome = simulated(a=code).run()
    assert outcome.lines["a"] == ["main", "worker"]
    assert 2 < outcome.time < 3


def test_exception_fails_the_run_with_the_lines_of_the_users_files_only(simulated):
    loaded = simulated(
        a="""
        import asyncio
        async def main():
            raise ValueError("no battery")
        asyncio.run(main())
        """
    )
    failure = loaded.explain()
    assert failure.kind == "exception in a"
    assert failure.text.rstrip().endswith("ValueError: no battery")
    assert "asyncio/" not in failure.text
    assert 'a.py", line 4, in main' in failure.text


def test_exception_in_a_thread_fails_the_run(simulated):
    loaded = simulated(
        a="""
        import threading
        def work(): raise ValueError("no battery")
        threading.Thread(target=work).start()
        """
    )
    failure = loaded.explain()
    assert failure.kind == "exception in a thread of a"
    assert "ValueError: no battery" in failure.text


def test_unhandled_interrupt_fails_the_run(simulated):
    loaded = simulated(a="raise KeyboardInterrupt")
    assert loaded.explain().kind == "exception in a"


def test_system_exit_in_a_thread_ends_the_thread_alone(simulated):
    loaded = simulated(
        a="""
        import sys, threading
        threading.Thread(target=sys.exit).start()
        print("on")
        """
    )
    assert loaded.run().lines["a"] == ["on"]


def test_ends_of_killed_programs_have_no_effect(simulated):
    loaded = simulated(
        """
        scenario.faults(crash=("a",), restart=(1.0, 1.0))

        @scenario.finally_
        def nothing_after_the_end(world):
            assert world.count("a", "cleanup") == 0, world.lines("a")
            assert world.count("a", "exit") == 0, world.lines("a")
            assert not world.messages("/never")
        """,
        duration=20,
        a="""
        import atexit, threading, time
        import rclpy
        from std_msgs.msg import String
        atexit.register(print, "exit")
        rclpy.init()
        publisher = rclpy.create_node("a").create_publisher(String, "never", 10)
        def work():
            try:
                while True:
                    time.sleep(0.3)
                    print("work")
            finally:
                publisher.publish(String())
                print("cleanup thread")
        threading.Thread(target=work).start()
        try:
            while True:
                print("tick")
                time.sleep(0.5)
        except BaseException:
            print("cleanup caught")
            raise
        finally:
            publisher.publish(String())
            print("cleanup")
            time.sleep(1)
            print("cleanup 2")
        """,
    )
    answer = loaded.search(*range(8))
    assert answer.failed is None
    assert answer.coverage.faults["kill"] > 1


def test_restart_loads_the_program_anew(simulated):
    loaded = simulated(
        """
        scenario.faults(crash=("a",), restart=(0.5, 1.0))

        @scenario.finally_
        def counted_from_one(world):
            lines = world.lines("a")
            assert lines.count("1 1 None 1") == world.starts("a"), lines
        """,
        duration=10,
        a="""
        import os, time, random, threading
        import counter
        value = 0
        while True:
            value += 1
            counter.value += 1
            print(value, counter.value, os.environ.get("SEEN"), threading.active_count())
            os.environ["SEEN"] = "yes"
            time.sleep(0.5)
        """,
    )
    (loaded.file.parent / "counter.py").write_text("value = 0\n")
    answer = loaded.search(*range(8))
    assert answer.failed is None
    assert answer.coverage.faults["kill"] > 1


def test_signal_handlers_belong_to_their_program(simulated):
    code = """
        import signal, time
        print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
        signal.signal(signal.SIGINT, print)
        time.sleep(1)
        print(signal.getsignal(signal.SIGINT) is print)
        """
    lines = simulated(a=code, b=code).run().lines
    assert lines["a"] == lines["b"] == ["True", "True"]


def test_programs_in_different_loops_call_each_other(simulated):
    outcome = simulated(robot=ROBOT, client=CLIENT).run()
    assert outcome.lines["client"] == ["answer 0", "answer 1", "answer 2"]
    assert outcome.lines["robot"] == ["picked 0", "picked 1", "picked 2"]


def test_module_name_of_the_standard_library_is_not_replaced_for_other_programs(simulated):
    loaded = simulated(
        a="import helper; print(helper.json.dumps([1]))", b="import json; print(json.dumps([2]))"
    )
    (loaded.file.parent / "helper.py").write_text("import json\n")
    assert loaded.run().lines == {"a": ["[1]"], "b": ["[2]"]}
