from srvgen.stubs.action_msgs.msg import *
