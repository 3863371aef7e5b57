"""What this machine does: how long a training step takes and its parts, an act, a start; what memory; who is faster.

`timing` holds the stopwatch, `report` what it gives; the other modules each measure one thing. Nothing here knows a
simulator: what is to be timed of one is passed in as a function.
"""
