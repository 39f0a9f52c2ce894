from srvgen.stubs.action_msgs.srv import *
