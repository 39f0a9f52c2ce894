from srvgen.stubs.turtlesim.action import *
