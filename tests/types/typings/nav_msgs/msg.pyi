from srvgen.stubs.nav_msgs.msg import *
