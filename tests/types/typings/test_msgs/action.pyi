from srvgen.stubs.test_msgs.action import *
