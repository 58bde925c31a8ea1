"""Runs in Python: metrics, tables of pandas, derived signals and figures, recorded or simulated.

run            a run: its metrics, frames, signals, parameters, figure
run_set        several runs: one table, one figure, one report
metric_values  the metrics of a run by name, with units
drawing        the figures of a comparison, as a notebook shows them
frames         the messages of a topic as a pandas DataFrame
description    unit and meaning of its columns, shown whole

`bags.load`, `bags.compare` and `experiments.drive` are the way in. pandas is optional: it comes
with the extra `frames` of this package, and only what returns a DataFrame needs it.
"""
