"""Lab 2, asynchronous: a server for your own type of service."""

import srvgen
import taskrpc

@TYPE@ = srvgen.load("@PACKAGE@/srv/@TYPE@")
SECONDS = {"move": @MOVE@, "scan": @SCAN@, "report": @REPORT@}  # how long each task takes

task_counter = 0


async def handle_task(request, response):
    global task_counter
    # 10. If request.@KIND@ is not in SECONDS, refuse the task and return the response:
    #     success is False, message contains the wrong task, task_id is -1,
    #     estimated_time is 0.0.
    # 11. Refuse it in the same way if request.@PRIORITY@ is less than 1, or more than your
    #     constant: @TYPE@.Request.MAX_@PRIORITY_CAPS@. Now message contains the wrong number.
    # 12. Otherwise accept the task: add 1 to task_counter, and respond with
    #     success True, a message, the counter as task_id, and the seconds of this task.
    return response


async def main():
    async with taskrpc.Node("task_server") as node:
        # 9. Create the service "@SERVICE@" of your type. Its callback is handle_task:
        #    node.create_service(type, name, callback)
        print("the server is ready")
        await node.spin()


taskrpc.run(main())
