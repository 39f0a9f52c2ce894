from srvgen.stubs.visualization_msgs.srv import *
