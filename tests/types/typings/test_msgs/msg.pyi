from srvgen.stubs.test_msgs.msg import *
