from srvgen.stubs.diagnostic_msgs.msg import *
