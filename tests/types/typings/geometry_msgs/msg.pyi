from srvgen.stubs.geometry_msgs.msg import *
