"""Actions: goals that take time, with feedback and a result, over services and topics.

An action consists of three services and two topics (`names`), so every transport carries it. Start
with `server` and `client`; `states`, the table of a goal's states, `names` and `goals` are pure,
and rclpy's `action` uses them too. Classes with ROS's names belong there, not here.
"""
