"""One run of a scenario, which follows from its seed.

`run` plays it. `choices` draws all chance; `network` and `observing` connect the programs with it
and with the `trace`; `ends` judges what still waits when nothing more happens.
"""
