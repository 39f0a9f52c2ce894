"""A fake of what the engine uses of rclpy, inside one process: one `Graph` for all contexts.

Messages arrive at once, in the thread of the publisher. `Ros()` stands for the package `rclpy`.
"""

from __future__ import annotations

import threading
from array import array
from collections import defaultdict
from enum import IntEnum
from types import SimpleNamespace

import srvgen
from srvgen._runtime import ARRAY_CLASSES


class Policy(IntEnum):
    """Stands for all policies of a quality of service."""

    KEEP_LAST = 1
    KEEP_ALL = 2
    RELIABLE = 3
    BEST_EFFORT = 4
    TRANSIENT_LOCAL = 5
    VOLATILE = 6
    AUTOMATIC = 7


class Context:
    """A context that only remembers its arguments."""

    def init(self, arguments, *, initialize_logging, domain_id):
        self.arguments = arguments
        self.domain_id = domain_id
        self.is_ok = True

    def ok(self):
        return self.is_ok

    def try_shutdown(self):
        self.is_ok = False

    def destroy(self):
        pass

    @property
    def enclave(self):
        found = self.arguments
        return found[found.index("--enclave") + 1] if "--enclave" in found else "/"


class InvalidHandle(Exception):
    """What rclpy raises when something that was destroyed is used."""


class Executor:
    """An executor without work: the fake calls callbacks directly."""

    def __init__(self, *, context):
        self.nodes = []
        self._woken = threading.Event()
        self.is_spinning = False

    def add_node(self, node):
        self.nodes.append(node)

    def remove_node(self, node):
        self.nodes.remove(node)

    def spin_once(self, timeout_sec):
        self.is_spinning = True
        self._woken.wait(timeout_sec)
        self._woken.clear()
        self.is_spinning = False

    def create_task(self, callback):
        self._woken.set()

    def shutdown(self, timeout_sec):
        assert not self.is_spinning


class Ros:
    """The fake package; `nodes` is the graph."""

    def __init__(self):
        self.nodes = []
        self.topics = defaultdict(list)
        """The publishers and subscriptions by topic."""
        self.services = {}
        self.qos = SimpleNamespace(
            QoSProfile=lambda **values: SimpleNamespace(**values),
            HistoryPolicy=Policy,
            ReliabilityPolicy=Policy,
            DurabilityPolicy=Policy,
            LivelinessPolicy=Policy,
            qos_policy_name_from_kind=str,
        )
        self.duration = SimpleNamespace(Duration=lambda *, seconds: seconds)
        callbacks = lambda **values: SimpleNamespace(**values)  # noqa: E731
        self.event_handler = SimpleNamespace(
            PublisherEventCallbacks=callbacks, SubscriptionEventCallbacks=callbacks
        )
        self.context = SimpleNamespace(Context=Context)
        self.executors = SimpleNamespace(SingleThreadedExecutor=Executor)
        self.exceptions = SimpleNamespace(InvalidHandle=InvalidHandle)
        self.parameter = SimpleNamespace(Parameter=lambda name, *, value: (name, value))
        self.node = SimpleNamespace(Node=self.new_node)
        self.serialization = SimpleNamespace(deserialize_message=self.deserialize)

    def new_node(self, name, *, context=None, namespace="/", **_):
        node = Node(self, name, namespace, context.enclave if context else "/")
        self.nodes.append(node)
        return node

    def deserialize(self, data, cls):
        raise ValueError("not a message")


class Endpoint:
    """A publisher or a subscription."""

    def __init__(self, node, topic, qos, callback=None, events=None):
        self.node, self.topic, self.qos = node, topic, qos
        self.callback = callback
        self.events = events
        self.last = None
        self.waited = []
        """How long it waited for the last messages."""
        self.node.ros.topics[topic].append(self)
        for other in self.others:
            for each in (self, other):
                if getattr(each.events, "matched", None):
                    each.events.matched(None)
            if callback and other.last and qos.durability == Policy.TRANSIENT_LOCAL:
                callback(other.last)

    @property
    def others(self):
        every = self.node.ros.topics[self.topic]
        return [each for each in every if (each.callback is None) != (self.callback is None)]

    def publish(self, body):
        self.last = body
        for each in self.others:
            each.callback(body)

    def wait_for_all_acked(self, seconds):
        self.waited.append(seconds)
        return True

    def get_subscription_count(self):
        return len(self.others)

    get_publisher_count = get_subscription_count


class Service:
    """A service; `send_response` returns the response to the client."""

    def __init__(self, callback):
        self.callback = callback

    def request(self, request, future):
        self.send_response(self.callback(request, None), future)

    def send_response(self, response, header):
        header.finish(response)


class Future:
    """rclpy's future."""

    def __init__(self, begin):
        self._begin = begin
        self._callbacks = []
        self._result = None

    def add_done_callback(self, callback):
        self._callbacks.append(callback)
        self._begin(self)

    def finish(self, result):
        self._result = result
        for each in self._callbacks:
            each(self)

    def exception(self):
        return None

    def cancelled(self):
        return False

    def result(self):
        return self._result


class Client:
    """A client; `pending` has the futures that were not removed."""

    def __init__(self, ros, name):
        self.ros, self.name = ros, name
        self.pending = []

    def service_is_ready(self):
        return self.name in self.ros.services

    def call_async(self, request):
        service = self.ros.services[self.name]
        future = Future(lambda future: service.request(request, future))
        self.pending.append(future)
        return future

    def remove_pending_request(self, future):
        self.pending.remove(future)


class Node:
    """A node of the fake."""

    def __init__(self, ros, name, namespace, enclave):
        self.ros, self.name, self.namespace, self.enclave = ros, name, namespace, enclave
        self.service_types = {}
        """What `get_service_names_and_types_by_node` returns."""
        self.published = {}
        self.hashes = {}
        """The hash of each DDS topic."""

    def create_publisher(self, cls, topic, qos, event_callbacks=None):
        return Endpoint(self, topic, qos, events=event_callbacks)

    def create_subscription(self, cls, topic, callback, qos, *, raw, event_callbacks=None):
        assert raw
        return Endpoint(self, topic, qos, callback, event_callbacks)

    def destroy_publisher(self, endpoint):
        self.ros.topics[endpoint.topic].remove(endpoint)

    destroy_subscription = destroy_publisher

    def create_service(self, cls, name, callback, *, qos_profile):
        service = self.ros.services[name] = Service(callback)
        return service

    def destroy_service(self, service):
        for name in [name for name, each in self.ros.services.items() if each is service]:
            del self.ros.services[name]

    def create_client(self, cls, name):
        return Client(self.ros, name)

    def destroy_client(self, client):
        pass

    def destroy_node(self):
        self.ros.nodes.remove(self)

    def get_node_names_and_namespaces_with_enclaves(self):
        return [(each.name, each.namespace, each.enclave) for each in self.ros.nodes]

    def get_service_names_and_types(self):
        return [item for each in self.ros.nodes for item in each.service_types.items()]

    def get_topic_names_and_types(self):
        return [item for each in self.ros.nodes for item in each.published.items()]

    def get_service_names_and_types_by_node(self, name, namespace):
        return list(self._find(name, namespace).service_types.items())

    def get_client_names_and_types_by_node(self, name, namespace):
        return []

    def get_publishers_info_by_topic(self, topic, *, no_mangle=False):
        return [
            self._info(each, (each.published.get(topic) or ["DDS type"])[0], each.hashes.get(topic))
            for each in self.ros.nodes
            if topic in each.published or topic in each.hashes
        ]

    def get_subscriptions_info_by_topic(self, topic, *, no_mangle=False):
        return self.get_publishers_info_by_topic(topic) if no_mangle else []

    def _find(self, name, namespace):
        found = [
            each for each in self.ros.nodes if (each.name, each.namespace) == (name, namespace)
        ]
        if not found:
            raise LookupError("the node does not exist")
        return found[0]

    def _info(self, node, type_name, type_hash):
        profile = SimpleNamespace(
            depth=0, reliability=Policy.RELIABLE, durability=Policy.TRANSIENT_LOCAL
        )
        return SimpleNamespace(
            node_name=node.name,
            node_namespace=node.namespace,
            topic_type=type_name,
            topic_type_hash=type_hash or "INVALID",
            qos_profile=profile,
        )


_made = {}


def ros_message(type_name):
    """Return a class such as ROS generates for a message."""
    if type_name not in _made:
        _made[type_name] = _generated(srvgen.load(type_name))
    return _made[type_name]


def ros_service(type_name):
    """Return a class such as ROS generates for a service."""
    if type_name not in _made:
        ours = srvgen.load(type_name)
        parts = {"Request": _generated(ours.Request), "Response": _generated(ours.Response)}
        _made[type_name] = _Generated(ours.__name__, (), parts)
    return _made[type_name]


def ros_action(type_name):
    """Return a class such as ROS generates for an action, with `Impl`."""
    if type_name not in _made:
        ours = srvgen.load(type_name)
        parts = {
            name: ros_message(f"{type_name}_{name}") for name in ("Goal", "Result", "Feedback")
        }
        impl = {
            "SendGoalService": ros_service(f"{type_name}_SendGoal"),
            "GetResultService": ros_service(f"{type_name}_GetResult"),
            "FeedbackMessage": ros_message(f"{type_name}_FeedbackMessage"),
        }
        parts["Impl"] = type("Impl", (), impl)
        _made[type_name] = _Generated(ours.__name__, (), parts)
    return _made[type_name]


class _Generated(type):
    def __import_type_support__(cls): ...


def _generated(ours):
    attributes = dict(zip((name for name, _ in ours._FIELDS), ours.__struct_fields__, strict=True))

    def start(self, **values):
        made = ours()
        for name, attribute in attributes.items():
            setattr(self, name, values.get(name, _plain(getattr(made, attribute))))

    def equal(self, other):
        return type(self) is type(other) and vars(self) == vars(other)

    fields = ours.get_fields_and_field_types()
    body = {
        "__init__": start,
        "__eq__": equal,
        "__hash__": None,
        "get_fields_and_field_types": classmethod(lambda cls: dict(fields)),
    }
    return _Generated(ours.__name__, (), body)


def _plain(value):
    if hasattr(value, "_FIELDS"):
        return ros_message(value._TYPE)()
    if isinstance(value, tuple(ARRAY_CLASSES.values())):
        return array(value._CODE, value)
    return [_plain(each) for each in value] if isinstance(value, list) else value
