from srvgen.stubs.std_msgs.msg import *
