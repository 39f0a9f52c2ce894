from srvgen.stubs.diagnostic_msgs.srv import *
