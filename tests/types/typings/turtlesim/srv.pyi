from srvgen.stubs.turtlesim.srv import *
