from srvgen.stubs.std_srvs.srv import *
