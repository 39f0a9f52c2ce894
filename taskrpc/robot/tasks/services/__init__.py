"""The services, topics and the action through which programs reach a robot's tasks.

Start reading with `offered_tasks`: it offers all of them for the server of one robot, and for each
server of a fleet. `permissions` decides who may do what, and `pages` divides a long list of tasks.
`topics` publishes changes of the queue and of the robot's state, and `action` offers
tasks as goals.
"""
