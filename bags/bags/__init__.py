"""Record runs to MCAP, play and repair them, and evaluate and compare them offline.

storage         read, write and repair bags; needs no ROS
playback        which message is sent when; a clock that pauses, steps and seeks
evaluation      one run as arrays, its metrics, the timing of its controller
report          table, JSON, CSV, figures and report.html of several runs
figures         Matplotlib figures
viewers         markers and a server for Foxglove
commands        the subcommands of `bags`, one module each; started by cli, parsed by command_line
errors          errors and warnings of the package
second_process  a function in a second process while this one continues

The command `bags` and the nodes recorder_node, player_node, markers_node and view_node are built
from these; the docstring of each package lists its modules. Nothing here imports a controller.
docs/bags.md, docs/report.md and docs/viewers.md are the manuals.
"""
