"""A submission in child processes, with limits: `child_trial` starts them, `child` is their start.

The checks run in the parent, which a submission cannot reach except through its services and its
output. So a submission can pass only by behaving as the checks expect.
"""
