"""Programs that publish and subscribe.

Run `talker` in one terminal and `listener` in another. They use the topic `chatter`.
Services are in `demo_nodes_py.services`.
"""
