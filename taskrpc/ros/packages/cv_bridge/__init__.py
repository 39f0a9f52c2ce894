"""Images as NumPy arrays, with the class of ROS's `cv_bridge`.

`CvBridge` converts messages to the arrays that OpenCV uses, and back. It needs NumPy; only Bayer,
YUV and compressed images need OpenCV too. `encodings` has the names of encodings, `colours`
converts between them. Only programs import this package.
"""

from .bridge import CvBridge, CvBridgeError, cvtColor2, getCvType

__all__ = ["CvBridge", "CvBridgeError", "cvtColor2", "getCvType"]
