from srvgen.stubs.trajectory_msgs.msg import *
