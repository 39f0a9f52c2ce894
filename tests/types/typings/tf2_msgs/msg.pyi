from srvgen.stubs.tf2_msgs.msg import *
