"""One drive of a batch, as a worker simulates it."""

import json
import time

from bags.evaluation.flattening import flatten
from experiments.batch import run_spec
from experiments.simulation import Setup


def simulate(setup: Setup) -> str:
    """Simulate once; return the results of the drive as JSON, by dotted name.

    These are the metrics under their names in comparison.json, `verdict` among them, the record of
    the solver (`solver.*`), and the wall and processor time [s] of the drive and its evaluation.
    """
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    results = run_spec.measure_setup(setup)
    values = flatten({**results['metrics'], 'solver': results['solver']})
    values['wall_s'] = time.perf_counter() - wall_s
    values['cpu_s'] = time.process_time() - cpu_s
    return json.dumps(values, allow_nan=False)
