"""Topics between real programs: after a kill and restart, by address, and with a token."""

import os
import subprocess
import sys
import time

import pytest

import srvgen
import taskrpc.sync

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

Int32 = srvgen.load("std_msgs/msg/Int32")
TALKER = """
import sys
import srvgen
import taskrpc.sync
Int32 = srvgen.load("std_msgs/msg/Int32")
with taskrpc.sync.Node("talker", listen=sys.argv[1] or None) as node:
    publisher = node.create_publisher(Int32, "counts")
    print(node.address, flush=True)
    number = 0
    def tick():
        global number
        number += 1
        publisher.publish(Int32(data=number))
    node.create_timer(0.01, tick)
    node.spin()
"""
LAST_WORDS = """
import time
import srvgen
import taskrpc.sync
Int32 = srvgen.load("std_msgs/msg/Int32")
node = taskrpc.sync.Node("talker")
with node:
    publisher = node.create_publisher(Int32, "counts")
    while not publisher.get_subscription_count():
        time.sleep(0.005)
    for number in range(200):
        publisher.publish(Int32(data=number))
"""


class Listener:
    def __init__(self, **options):
        self.got = []
        self.node = taskrpc.sync.Node("listener", **options)

    def __enter__(self):
        self.node.__enter__()
        take = lambda message: self.got.append(message.data)  # noqa: E731
        self.subscription = self.node.create_subscription(Int32, "counts", take, 1000)
        return self

    def __exit__(self, *_):
        self.node.destroy()

    def wait(self, count):
        ends_at = time.monotonic() + 60
        while len(self.got) < count:
            assert time.monotonic() < ends_at, f"{len(self.got)} messages came"
            time.sleep(0.005)


def talker(listen="", **environment):
    process = subprocess.Popen(
        [sys.executable, "-c", TALKER, listen],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    return process, process.stdout.readline().strip()


def end(process, *, at_once=False):
    process.kill() if at_once else process.terminate()
    process.wait(60)
    process.stdout.close()


def test_subscriber_finds_a_killed_publisher_after_its_restart():
    with Listener() as listener:
        for life in range(2):
            process, _ = talker()
            listener.wait(len(listener.got) + 5)
            end(process, at_once=True)
            ends_at = time.monotonic() + 60
            while listener.subscription.get_publisher_count():
                assert time.monotonic() < ends_at
                time.sleep(0.005)
            ones = [number for number in listener.got if number == 1]
            assert len(ones) <= life + 1
        assert listener.subscription.lost == 0


def test_subscriber_reaches_a_publisher_by_address_also_after_its_restart(monkeypatch):
    monkeypatch.setenv("TASKRPC_TOKEN", "a secret of sixteen")
    process, place = talker()
    with Listener(peers=[place]) as listener:
        listener.wait(5)
        end(process)
        before = len(listener.got)
        process, again = talker(place)
        assert again == place
        listener.wait(before + 5)
        end(process)


def test_messages_published_before_exit_arrive():
    with Listener() as listener:
        subprocess.run([sys.executable, "-c", LAST_WORDS], check=True, timeout=120)
        listener.wait(200)
        assert listener.got == list(range(200))
