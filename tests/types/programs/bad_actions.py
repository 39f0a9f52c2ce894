"""Wrong goals, results and feedback of actions."""

import srvgen
import taskrpc
from taskrpc import sync

srvgen.install_import_hook()

from my_interfaces.action import Count
from my_interfaces.srv import Add

CountGoal = taskrpc.ServerGoal[Count.Goal, Count.Result, Count.Feedback]


async def count(goal: CountGoal) -> Count.Result:
    goal.publish_feedback(Count.Result())
    # mypy reports: Argument 1 to "publish_feedback" of "ServerGoal" has incompatible type "Count_Result"; expected "Count_Feedback"
    # pyright reports: …"Count_Result" is not assignable to "Count_Feedback"
    print(goal.request.tarket)
    # mypy reports: "Count_Goal" has no attribute "tarket"; maybe "target"?
    # pyright reports: Cannot access attribute "tarket" for class "Goal"
    return goal.canceled(Count.Feedback())
    # mypy reports: Argument 1 to "canceled" of "ServerGoal" has incompatible type "Count_Feedback"; expected "Count_Result"
    # pyright reports: …"Count_Feedback" is not assignable to "Count_Result"


def returns_nothing(goal: CountGoal) -> None:
    print(goal.goal_id)


def returns_feedback(goal: CountGoal) -> Count.Feedback:
    return Count.Feedback()


def accepts_another(goal: Count.Result) -> bool:
    return True


async def main(node: taskrpc.Node, blocking: sync.Node) -> None:
    node.create_action_server(Count, "count", returns_nothing)
    # mypy reports: Argument 3 to "create_action_server" of "Node" has incompatible type …
    # pyright reports: …Function return type "None" is incompatible…
    node.create_action_server(Count, "count", returns_feedback)
    # mypy reports: Argument 3 to "create_action_server" of "Node" has incompatible type …
    # pyright reports: …"Count" is incompatible with protocol "Action[Count_Goal, Count_Result | Feedback, Count_Feedback]"
    # pyright reports: …"Count_Result | Feedback" is not the same as "Result"
    node.create_action_server(Count, "count", count, goal=accepts_another)
    # mypy reports: Argument "goal" to "create_action_server" of "Node" has incompatible type …
    # pyright reports: …"Count_Goal" is not assignable to "Count_Result"
    node.create_action_client(Add, "count")
    # mypy reports: Argument 1 to "create_action_client" of "Node" has incompatible type "type[Add]"; expected …
    # pyright reports: …"Add" is incompatible with protocol "Action…
    client = node.create_action_client(Count, "count")
    handle = await client.send_goal(Count.Result())
    # mypy reports: Argument 1 to "send_goal" of "ActionClient" has incompatible type "Count_Result"; expected "Count_Goal"
    # pyright reports: …"Count_Result" is not assignable to "Count_Goal"
    async for feedback in handle.feedback:
        print(feedback.target)
        # mypy reports: "Count_Feedback" has no attribute "target"
        # pyright reports: Cannot access attribute "target" for class "Count_Feedback"
    print((await handle.result()).sumary)
    # mypy reports: "Count_Result" has no attribute "sumary"; maybe "summary"?
    # pyright reports: Cannot access attribute "sumary" for class "Count_Result"
    blocking.create_action_client(Count, "count").send_goal(Add.Request())
    # mypy reports: Argument 1 to "send_goal" of "ActionClient" has incompatible type "Add_Request"; expected "Count_Goal"
    # pyright reports: …"Add_Request" is not assignable to "Count_Goal"
