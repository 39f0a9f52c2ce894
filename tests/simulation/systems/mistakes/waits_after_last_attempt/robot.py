from std_srvs.srv import SetBool

from taskrpc import sync


def light(request, response):
    print("light on" if request.data else "light off")
    response.success = True
    return response


with sync.Node("robot") as node:
    node.create_service(SetBool, "light", light)
    node.spin()
