from srvgen.stubs.example_interfaces.srv import *
