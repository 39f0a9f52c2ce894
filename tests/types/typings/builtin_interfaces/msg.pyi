from srvgen.stubs.builtin_interfaces.msg import *
