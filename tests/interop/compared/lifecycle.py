"""A lifecycle node: transitions, refusals, errors, its publisher and its services."""

import rclpy
from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from shared import attempt, end
from std_msgs.msg import String

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class Lidar(LifecycleNode):
    """Returns what the program asks for."""

    returns = SUCCESS

    def _note(self, name, state):
        print(" ", name, state.label, state.state_id, flush=True)
        if isinstance(self.returns, Exception):
            raise self.returns
        return self.returns

    def on_configure(self, state: State):
        result = self._note("on_configure", state)
        self.pub = self.create_lifecycle_publisher(String, "scan", 1)
        return result

    def on_activate(self, state: State):
        super().on_activate(state)
        return self._note("on_activate", state)

    def on_deactivate(self, state: State):
        super().on_deactivate(state)
        return self._note("on_deactivate", state)

    def on_cleanup(self, state: State):
        return self._note("on_cleanup", state)

    def on_shutdown(self, state: State):
        return self._note("on_shutdown", state)

    def on_error(self, state: State):
        print("  on_error", state.label, flush=True)
        return SUCCESS


def state(node):
    """The id and the label; no public method has them."""
    now = node._state_machine.current_state
    return tuple(now) if isinstance(now, tuple) else (now.id, now.label)


rclpy.init()
node = Lidar("lidar", enable_communication_interface=True)
attempt("first", lambda: state(node))
for trigger in ("activate", "configure", "configure", "activate", "deactivate", "cleanup"):
    action = getattr(node, f"trigger_{trigger}")
    attempt(trigger, lambda action=action: action().name)
    attempt("state", lambda: state(node))
node.returns = FAILURE
attempt("failed configure", lambda: node.trigger_configure().name)
attempt("state", lambda: state(node))
node.returns = ERROR
attempt("error in configure", lambda: node.trigger_configure().name)
attempt("state", lambda: state(node))
node.returns = ValueError("x")
attempt("exception in configure", lambda: node.trigger_configure().name)
attempt("state", lambda: state(node))
node.returns = SUCCESS
attempt("configure", lambda: node.trigger_configure().name)
attempt("inactive publisher", lambda: (node.pub.is_activated, node.pub.publish(String())))
attempt("activate", lambda: node.trigger_activate().name)
attempt("active publisher", lambda: node.pub.is_activated)
attempt("wrong", lambda: node.trigger_configure().name)
attempt(
    "services",
    lambda: sorted(
        name
        for name, _ in node.get_service_names_and_types_by_node("lidar", "/")
        if "state" in name or "transition" in name
    ),
)
attempt("shutdown", lambda: node.trigger_shutdown().name)
attempt("state", lambda: state(node))
attempt("after", lambda: node.trigger_configure().name)
end()
