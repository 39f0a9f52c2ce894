from srvgen.stubs.taskrpc_interfaces.msg import *
