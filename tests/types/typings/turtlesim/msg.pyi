from srvgen.stubs.turtlesim.msg import *
