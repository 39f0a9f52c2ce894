from srvgen.stubs.tf2_msgs.action import *
