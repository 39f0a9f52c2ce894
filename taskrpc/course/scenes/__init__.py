"""Eleven scenes for a lecture: small programs with a typical mistake, and the same programs cured.

Start with `catalogue`, which says for each scene what the class sees, why, and the cure. `programs`
has the programs as a student would write them, for rclpy where that is possible. `stage` offers a
robot and injects the faults of a scene, `player` runs a program there and reports what happens, and
`moments` puts what they report into words. Nothing here prints: that is `taskrpc.cli.course.scene`.
"""
