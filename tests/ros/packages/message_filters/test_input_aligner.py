"""The filter that passes messages of several inputs on in the order of their times."""

import importlib
from types import SimpleNamespace

import pytest

MILLISECOND = 1_000_000


@pytest.fixture
def aligner_of(ros_names):
    module = importlib.import_module("message_filters.input_aligner")
    simple = importlib.import_module("message_filters").SimpleFilter
    duration = importlib.import_module("rclpy.duration").Duration
    time = importlib.import_module("builtin_interfaces.msg").Time

    def made(inputs=2, timeout=1000, period=2):
        """An aligner with times in milliseconds, and the times that it has passed on."""
        filters, found = [simple() for _ in range(inputs)], []
        aligner = module.InputAligner(duration(nanoseconds=timeout * MILLISECOND), *filters)
        for index in range(inputs):
            number = aligner.registerCallback(index, lambda one: found.append(one.data))
            assert number == 0
            aligner.setInputPeriod(index, duration(nanoseconds=period * MILLISECOND))

        def send(index, *times):
            for each in times:
                header = SimpleNamespace(stamp=time(nanosec=each * MILLISECOND))
                filters[index].signalMessage(SimpleNamespace(header=header, data=each))

        return aligner, send, found

    return made


def test_messages_of_all_inputs_are_passed_on_in_the_order_of_their_times(aligner_of):
    aligner, send, found = aligner_of(inputs=4, period=4)
    for index, times in ((2, (3, 7)), (0, (1, 5, 9, 9)), (3, (2, 6)), (1, (4, 8))):
        send(index, *times)
    assert found == []
    aligner.dispatchMessages()
    assert found == [1, 2, 3, 4, 5, 6, 7, 8, 9, 9]


def test_a_message_waits_for_an_input_whose_next_message_is_due(aligner_of):
    aligner, send, found = aligner_of(timeout=10)
    send(0, 1, 3, 5, 7, 9, 11, 13, 15)
    send(1, 2, 4)
    aligner.dispatchMessages()
    assert found == [1, 2, 3, 4, 5]
    assert aligner.getQueueStatus(1).active
    send(0, 17)
    aligner.dispatchMessages()
    assert found == [1, 2, 3, 4, 5, 7, 9, 11, 13, 15, 17]
    assert not aligner.getQueueStatus(1).active


def test_a_message_older_than_one_that_was_passed_on_is_dropped(aligner_of):
    aligner, send, found = aligner_of()
    send(1, 4)
    send(0, 3)
    aligner.dispatchMessages()
    send(0, 1, 5, 7)
    send(1, 2, 6)
    aligner.dispatchMessages()
    assert found == [3, 4, 5, 6, 7]
    status = aligner.getQueueStatus(0)
    assert (status.queue_size, status.msgs_processed, status.msgs_dropped) == (0, 3, 1)


def test_a_callback_may_add_a_message(aligner_of):
    aligner, send, found = aligner_of(inputs=1)
    aligner.registerCallback(0, lambda one: send(0, one.data + 1) if one.data < 4 else None)
    send(0, 1)
    aligner.dispatchMessages()
    assert found == [1, 2, 3, 4]


def test_other_inputs_replace_the_earlier_ones(aligner_of):
    aligner, send, found = aligner_of()
    aligner.connectInput(filters=[])
    send(0, 1)
    aligner.dispatchMessages()
    assert (found, aligner.event_queues, aligner.getName()) == ([], [], "")


def test_a_timer_of_a_node_dispatches(aligner_of):
    aligner, send, found = aligner_of(inputs=1)
    timers = []
    node = SimpleNamespace(create_timer=lambda *timer: timers.append(timer))
    aligner.setupDispatchTimer(node, importlib.import_module("rclpy.duration").Duration(seconds=2))
    ((period, dispatch),) = timers
    send(0, 1)
    dispatch()
    assert (period, found) == (2.0, [1])
