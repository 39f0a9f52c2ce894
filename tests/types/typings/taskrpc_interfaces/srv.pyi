from srvgen.stubs.taskrpc_interfaces.srv import *
