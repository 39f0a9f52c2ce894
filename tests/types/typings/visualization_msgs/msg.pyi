from srvgen.stubs.visualization_msgs.msg import *
