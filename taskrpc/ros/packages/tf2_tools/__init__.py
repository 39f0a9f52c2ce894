"""The program `view_frames` of ROS's `tf2_tools`, which draws the tree of frames.

`taskrpc run tf2_tools view_frames` starts it, and so does `taskrpc run tf2_ros view_frames`.
It needs graphviz only for the PDF. The other programs for transforms are in `tf2_ros`.
"""
