"""Calls a service with roslibpy, and prints the error with which the call ends.

Arguments: the port of the gateway, the transport (twisted or asyncio), the service.
"""

import sys

import roslibpy

port, transport, service = int(sys.argv[1]), sys.argv[2], sys.argv[3]
roslibpy.set_default_transport(transport)
ros = roslibpy.Ros("127.0.0.1", port)
ros.run(30)
target = roslibpy.Service(ros, service, "std_srvs/Trigger")
print("calling", flush=True)
try:
    print(target.call(roslibpy.ServiceRequest(), timeout=30))
except roslibpy.core.ServiceException as error:
    print(error)
