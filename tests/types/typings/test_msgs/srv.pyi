from srvgen.stubs.test_msgs.srv import *
