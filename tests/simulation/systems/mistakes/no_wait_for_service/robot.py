from std_srvs.srv import Trigger

from taskrpc import sync


def battery(request, response):
    response.success = True
    response.message = "80 %"
    return response


with sync.Node("robot") as node:
    node.create_service(Trigger, "battery", battery)
    node.spin()
