from srvgen.stubs.shape_msgs.msg import *
