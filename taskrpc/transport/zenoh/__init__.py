"""The engine for Zenoh, in the wire format of ROS 2's rmw_zenoh.

Start with `zenoh_engine`. The formats are pure: `keys` are the key expressions, `tokens` describe
nodes and their services and topics, `attachment` goes with each message, `graph` collects the
tokens. `configuration` reads the settings. `session` opens Zenoh and passes what its threads
receive to the event loop; `services` and `topics` are the native ones. Only `session`, `services`
and `topics` import Zenoh's library.
"""
