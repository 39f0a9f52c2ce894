from srvgen.stubs.example_interfaces.msg import *
