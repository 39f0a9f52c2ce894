from srvgen.stubs.rcl_interfaces.srv import *
