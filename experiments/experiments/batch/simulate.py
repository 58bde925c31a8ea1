"""One drive of a batch, as a worker simulates it."""

import json
import time
from typing import Any

from experiments.simulation import Setup
from experiments.study import run_spec


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


def flatten(value: Any, name: str = '') -> dict[str, Any]:
    """Return the single values in mappings and lists by dotted name: `overshoots.0.x_m`."""
    if isinstance(value, dict):
        members = value.items()
    elif isinstance(value, list):
        members = enumerate(value)
    else:
        return {name: value}
    flat = {}
    for key, member in members:
        flat.update(flatten(member, f'{name}.{key}' if name else str(key)))
    return flat
