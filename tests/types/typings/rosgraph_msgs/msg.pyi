from srvgen.stubs.rosgraph_msgs.msg import *
