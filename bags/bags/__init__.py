"""Record runs to MCAP, play and repair them, and evaluate and compare them offline.

analysis        runs in Python: metrics, DataFrames, derived signals, figures
storage         read, write and repair bags; needs no ROS
playback        which message is sent when; a clock that pauses, steps and seeks
evaluation      one run as arrays, its metrics, the timing of its controller
report          table, JSON, CSV, figures and report.html of several runs
figures         Matplotlib figures
viewers         what markers show
commands        the subcommands of `bags`, one module each; started by cli, parsed by command_line
errors          errors and warnings of the package
second_process  a function in a second process while this one continues

The command `bags` and the nodes recorder_node, player_node and markers_node are built from
these; the docstring of each package lists its modules. Nothing here imports a controller.
docs/bags.md and docs/report.md are the manuals. In Python:

    import bags

    run = bags.load('bags/runs/double_lane_change/mpcc')
    run.metrics['min_v2o_m']
    run.frame('/vehicle/odometry')
"""

from typing import TYPE_CHECKING

from node_runtime.lazy_names import lazy_names

if TYPE_CHECKING:
    from bags.analysis.run import Run, load
    from bags.analysis.run_set import RunSet, compare

__all__ = ['Run', 'RunSet', 'compare', 'load']
# imported when they are first used: nodes need none of them
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        'Run': 'bags.analysis.run',
        'RunSet': 'bags.analysis.run_set',
        'compare': 'bags.analysis.run_set',
        'load': 'bags.analysis.run',
    },
)
