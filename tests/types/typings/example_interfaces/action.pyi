from srvgen.stubs.example_interfaces.action import *
