from srvgen.stubs.rcl_interfaces.msg import *
