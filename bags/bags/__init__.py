"""Record runs to MCAP, play and repair them, and evaluate and compare them offline.

run             a run in Python: metrics, DataFrames, derived signals, figures
run_set         several runs: one table, one figure, one report
frames          the messages of a topic as a pandas DataFrame; unit and meaning of its columns
metrics_table   the metrics as a table and as CSV
storage         read, write and repair bags; needs no ROS
evaluation      one run as arrays, its metrics, the timing of its controller
report          table, JSON, CSV, figures and report.html of several runs
figures         Matplotlib figures
commands        the subcommands of `bags`, one module each; started by cli, parsed by command_line
errors          errors and warnings of the package

The command `bags` and the nodes recorder_node, player_node and markers_node are built from
these; the docstring of each package lists its modules. Nothing here imports a controller.
docs/bags.md and docs/report.md are the manuals. In Python:

    import bags

    run = bags.load('bags/runs/double_lane_change/mpcc')
    run.metrics['min_v2o_m']
    run.frame('/vehicle/odometry')
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bags.run_set import Run, RunSet, compare, load

__all__ = ['Run', 'RunSet', 'compare', 'load']


def __getattr__(name: str) -> Any:
    """Import a name of __all__ when it is first used: nodes need none of them."""
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module('bags.run_set'), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
