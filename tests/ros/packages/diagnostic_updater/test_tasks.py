"""Nodes report their state on `/diagnostics`."""

import importlib
from types import SimpleNamespace

import pytest


@pytest.fixture
def diagnostics(ros_names):
    return importlib.import_module("diagnostic_updater")


@pytest.fixture
def node(ros_names):
    return FakeNode(importlib.import_module("builtin_interfaces.msg").Time)


class FakeNode:
    """Keeps what a node would publish and log."""

    def __init__(self, time):
        self.published, self.warnings, self.parameters, self.timers = [], [], {}, []
        stamp = SimpleNamespace(to_msg=lambda: time(sec=5))
        self.get_clock = lambda: SimpleNamespace(now=lambda: stamp)
        self.get_logger = lambda: SimpleNamespace(warning=self.warnings.append)
        self.has_parameter = self.parameters.__contains__
        self.get_name = lambda: "driver"
        self.get_fully_qualified_name = lambda: "/arm/driver"

    def create_publisher(self, msg_type, topic, qos):
        assert topic == "/diagnostics"
        return SimpleNamespace(publish=self.published.append)

    def create_timer(self, period, callback):
        self.timers.append((period, callback))

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.parameters.setdefault(name, default))

    def get_parameter(self, name):
        return SimpleNamespace(value=self.parameters[name])


def test_updater_publishes_the_reports_of_its_tasks(diagnostics, node):
    updater = diagnostics.Updater(node)
    updater.setHardwareID("arm 1")

    def temperature(status):
        status.summary(b"\1", "warm")
        status.add("degrees", 71)
        return status

    updater.add("temperature", temperature)
    updater.add(diagnostics.Heartbeat())
    starting = [array.status[0] for array in node.published]
    assert [one.name for one in starting] == ["driver: temperature", "driver: Heartbeat"]
    assert {one.message for one in starting} == {"Node starting up"}
    (period, run) = node.timers[0]
    assert period == 1.0
    run()
    first, second = node.published[-1].status
    assert (first.level, first.message, first.hardware_id) == (b"\1", "warm", "arm 1")
    assert [(one.key, one.value) for one in first.values] == [("degrees", "71")]
    assert (second.level, second.message) == (b"\0", "Alive")
    assert node.published[-1].header.stamp.sec == 5


def test_parameters_set_the_period_and_the_full_name(diagnostics, node):
    node.parameters.update({"diagnostic_updater.period": 0.5, "diagnostic_updater.use_fqn": True})
    updater = diagnostics.Updater(node)
    assert node.timers[0][0] == 0.5
    updater.add(diagnostics.Heartbeat())
    updater.broadcast(2, "shutting down")
    (one,) = node.published[-1].status
    assert (one.name, one.level, one.message) == ("/arm/driver: Heartbeat", b"\2", "shutting down")


def test_missing_hardware_id_is_logged_once(diagnostics, node):
    updater = diagnostics.Updater(node)
    updater.add(diagnostics.Heartbeat())
    updater.force_update()
    updater.update()
    assert len(node.warnings) == 1
    assert "setHardwareID" in node.warnings[0]


def test_task_must_be_a_function_that_returns_its_status(diagnostics, node):
    updater = diagnostics.Updater(node)
    with pytest.raises(TypeError, match="expected a function as the task 'motor', got NoneType"):
        updater.add("motor", None)
    updater.add("battery", lambda status: None)
    with pytest.raises(TypeError, match="'battery', got NoneType; is `return stat` missing"):
        updater.force_update()


def test_removed_task_is_not_run(diagnostics, node):
    updater = diagnostics.Updater(node)
    updater.add(diagnostics.Heartbeat())
    assert updater.removeByName("Heartbeat")
    assert not updater.removeByName("Heartbeat")
    updater.update()
    assert list(node.published[-1].status) == []


@pytest.mark.parametrize(
    ("first", "second", "merged"),
    [
        ((0, "fine"), (2, "broken"), (b"\2", "broken")),
        ((1, "warm"), (2, "broken"), (b"\2", "warm; broken")),
        ((2, "broken"), (0, "fine"), (b"\2", "broken")),
        ((0, ""), (0, "fine"), (b"\0", "fine")),
    ],
)
def test_merged_summary_has_the_higher_level(diagnostics, first, second, merged):
    status = diagnostics.DiagnosticStatusWrapper()
    status.summary(*first)
    status.mergeSummary(*second)
    assert (status.level, status.message) == merged
    status.clearSummary()
    assert (status.level, status.message) == (b"\0", "")


def test_composite_task_combines_its_tasks(diagnostics):
    def say(level, text):
        def run(status):
            status.summary(level, text)
            status.add(text, level)
            return status

        return diagnostics.FunctionDiagnosticTask(text, run)

    both = diagnostics.CompositeDiagnosticTask("both")
    for level, text in ((1, "warm"), (0, "fine"), (2, "broken")):
        both.addTask(say(level, text))
    status = both.run(diagnostics.DiagnosticStatusWrapper())
    assert (status.level, status.message) == (b"\2", "warm; broken")
    assert [one.key for one in status.values] == ["warm", "fine", "broken"]


@pytest.mark.parametrize(
    ("ticks", "level", "message"),
    [
        (0, b"\2", "No events recorded."),
        (5, b"\1", "Frequency too low."),
        (10, b"\0", "Desired frequency met"),
        (20, b"\1", "Frequency too high."),
    ],
)
def test_frequency_is_compared_with_its_bounds(diagnostics, ticks, level, message):
    now = [0.0]
    params = diagnostics.FrequencyStatusParam({"min": 10, "max": 10}, 0.1, 5)
    task = diagnostics.FrequencyStatus(params, now=lambda: now[0])
    for _ in range(ticks):
        task.tick()
    now[0] = 1.0
    status = task.run(diagnostics.DiagnosticStatusWrapper())
    assert (status.level, status.message) == (level, message)
    values = {one.key: one.value for one in status.values}
    assert values["Events in window"] == str(ticks)
    assert values["Target frequency (Hz)"] == "10.000000"


@pytest.mark.parametrize(
    ("stamps", "level", "message"),
    [
        ([], b"\1", "No data since last update."),
        ([99.0], b"\0", "Timestamps are reasonable."),
        ([102.0], b"\2", "Timestamps too far in future seen."),
        ([90.0, 99.0], b"\2", "Timestamps too far in past seen."),
        ([0], b"\2", "Zero timestamp seen."),
    ],
)
def test_times_are_compared_with_the_clock(diagnostics, stamps, level, message):
    task = diagnostics.TimeStampStatus(now=lambda: 100.0)
    for stamp in stamps:
        task.tick(stamp)
    status = task.run(diagnostics.DiagnosticStatusWrapper())
    assert (status.level, status.message) == (level, message)


def test_diagnosed_publisher_counts_what_it_publishes(diagnostics, node):
    published = []
    publisher = SimpleNamespace(topic_name="/pose", publish=published.append)
    updater = diagnostics.Updater(node)
    freq = diagnostics.FrequencyStatusParam({"min": 1})
    stamp = diagnostics.TimeStampStatusParam()
    watched = diagnostics.DiagnosedPublisher(publisher, updater, freq, stamp)
    message = importlib.import_module("geometry_msgs.msg").PoseStamped()
    watched.publish(message)
    assert published == [message]
    assert watched.freq.count == 1
    updater.update()
    (report,) = node.published[-1].status
    assert report.name == "driver: /pose topic status"
    assert "Zero timestamp seen." in report.message
