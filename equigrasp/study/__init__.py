"""The matrix behind a table: collect, train, choose a checkpoint, test, and one JSON line for each finished cell.

`matrix.py` says which cells there are, `work.py` and `cost.py` measure them, `results.py` keeps the lines,
`estimate.py` says how long the rest takes.
"""
