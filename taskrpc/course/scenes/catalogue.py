"""All scenes, in the order in which a lecture needs them; pure."""

from __future__ import annotations

from taskrpc.course.scenes.scene import Excerpt, Hang, Scene
from taskrpc.errors import TaskRpcError

SCENES: tuple[Scene, ...] = (
    Scene(
        name="lost-reply",
        title="The response is lost",
        sees="The caller gets no response, and the robot drives all the same.",
        ros="No response. ROS 2 has no request ids: a request needs a field for one.",
        why="The request has arrived, and the response is lost. The caller cannot distinguish"
        " this from a lost request.",
        cure="Send the request again with the same request id. The server recognises it, and"
        " returns the stored response: the robot has one task.",
        problem=Excerpt("future = client", "will the robot drive", ("timeout_sec=1.5",)),
        cured=Excerpt("try:", "accepted task", ("timeout=1.5", "timeout=3.0")),
        robot=True,
        faults=("lose-response:first=1",),
    ),
    Scene(
        name="late-answer",
        title="The response is late",
        sees="After 1 s the program reports a failure. Then the response arrives.",
        ros="The response is late: a timeout ends the spinning, not the call.",
        why="A timeout ends the wait, not the call. The server does not know that the caller"
        " has stopped waiting, and the robot executes the task.",
        cure="After a timeout, say that the result is unknown. Keep the future, and look again.",
        problem=Excerpt("future = client", "a moment later", ("the call failed",)),
        cured=Excerpt("future = client", "accepted task", ("timeout_sec=5.0",)),
        robot=True,
        faults=("delay-response:2s,first=1",),
    ),
    Scene(
        name="retry-without-id",
        title="A retry runs the task twice",
        sees="The user wanted one task, and the robot executes two.",
        ros="Two tasks: each attempt is a new request.",
        why="Only the response was lost. The lecture's retry sends a new request, and the server"
        " cannot know that it is the same task.",
        cure="Give all attempts one request id. The server executes the first one, and answers"
        " the others with the stored response.",
        problem=Excerpt("for attempt", "time.sleep(", ("client.call_async(request)",)),
        cured=Excerpt("for attempt", "time.sleep(", ("request_id=request_id",)),
        robot=True,
        faults=("lose-response:first=1",),
    ),
    Scene(
        name="timeout-too-short",
        title="The timeout is too short",
        sees="Both attempts time out, and the robot executes two tasks.",
        ros="Two tasks: each request is executed, also if the caller does not wait.",
        why="The server needs 1 s, and the caller waits for 0.4 s. Nothing is lost: each attempt"
        " adds work to a server that is slow already.",
        cure="Measure how long the server takes, and wait two to five times as long.",
        problem=Excerpt("for attempt", 'print("attempt"', ("timeout_sec=0.4",)),
        cured=Excerpt("future = client", "attempt 1", ("timeout_sec=3.0",)),
        robot=True,
        faults=("slow:1s,first=2",),
    ),
    Scene(
        name="deadlock",
        title="A callback waits for its own thread",
        sees="taskrpc finds the circle, and ends the call with WouldDeadlock.",
        ros="The program hangs, without a message.",
        why="One thread spins and runs all callbacks. It waits in double() for the response of"
        " add(), and only this thread could run add().",
        cure="Make the callback `async def`, and await the future. Both services and the client"
        " need a ReentrantCallbackGroup.",
        problem=Excerpt("def double(", "self.client.call(", ("self.client.call(",)),
        cured=Excerpt("async def double(", "await self.client", ("await self.client",)),
        hangs=Hang.LIKE_ROS,
    ),
    Scene(
        name="nobody-spins",
        title="No thread spins",
        sees="The future is never done. After 5 s, taskrpc prints why.",
        ros="The future stays pending for ever, without a message.",
        why="The response has arrived. Only a thread that spins takes it, and time.sleep does"
        " not spin.",
        cure="Spin while you wait: spin_once, spin_until_future_complete, or a thread that spins.",
        problem=Excerpt("future = client", "accepted task", ("time.sleep(2.0)",)),
        cured=Excerpt("future = client", "accepted task", ("rclpy.spin_once(",)),
        robot=True,
        hangs=Hang.ALWAYS,
    ),
    Scene(
        name="forgot-return",
        title="The callback forgets `return response`",
        sees="The server computes the sum, and the caller gets an error.",
        ros="A TypeError without a text ends the server. The caller waits for ever.",
        why="Without `return`, a Python function returns None. rclpy sends only what the callback"
        " returns.",
        cure="End each callback of a service with `return response`.",
        problem=Excerpt("def add(", 'print("add:', ('print("add:',)),
        cured=Excerpt("def add(", "return response", ("return response",)),
    ),
    Scene(
        name="wrong-type",
        title="The right name, the wrong type",
        sees="The client finds no server. taskrpc prints which type it has.",
        ros="The client finds no server, and prints nothing.",
        why="A service is a name and a type. A client with another type, or with another version"
        " of the .srv file, finds no server.",
        cure="Compare the types with `ros2 service type /robot_task`. Use that of the server.",
        problem=Excerpt("from std_srvs", "wait_for_service", ("create_client(",)),
        cured=Excerpt("from my_robot", "wait_for_service", ("create_client(",)),
        robot=True,
    ),
    Scene(
        name="two-servers",
        title="Two servers of one name",
        sees="Only the first server moves the arm, and taskrpc prints a warning.",
        ros="Both servers move the arm. The first response counts.",
        why="In ROS 2, all servers of a name get each request. A server that nobody has ended"
        " since yesterday is a second one.",
        cure="End the old server, or give it a name of its own.",
        problem=Excerpt("node = Node(", "the response is from", ('"the new server"',)),
        cured=Excerpt("node = Node(", "the response is from", ('"old/move_arm"',)),
    ),
    Scene(
        name="eleven-calls",
        title="More than ten calls at once",
        sees="All 12 calls get a response, and taskrpc prints a warning.",
        ros="It drops the oldest requests that wait. Their futures stay pending.",
        why="The QoS profile of services keeps ten requests. A further request replaces the"
        " oldest one that waits.",
        cure="Have at most ten calls in flight: wait for responses before you send more.",
        problem=Excerpt("futures = [", '"responses:"', ("futures = [",)),
        cured=Excerpt("for number", '"responses:"', ("spin_until_future_complete",)),
    ),
    Scene(
        name="same-box",
        title="It works, nine times of ten",
        sees="The run works. The simulator runs it again and again, until it fails.",
        ros="The run works, and nobody runs the program until it fails.",
        why="The group lets two callbacks run at once. If both customers come within 0.1 s, both"
        " callbacks read the same first box.",
        cure="A MutuallyExclusiveCallbackGroup, the default, runs one callback at a time. Simulate"
        " again: no run fails.",
        problem=Excerpt("group = ", "self.boxes = self.boxes", ("group = ", "time.sleep(")),
        cured=Excerpt("group = ", "self.boxes = self.boxes", ("group = ",)),
        simulated=True,
    ),
)


def scene(name: str) -> Scene:
    """Return a scene; raises TaskRpcError if there is none of this name."""
    for each in SCENES:
        if each.name == name:
            return each
    names = ", ".join(each.name for each in SCENES)
    raise TaskRpcError(f"there is no scene {name!r}; expected one of {names}")
