"""Record runs to MCAP, play and repair them, and evaluate and compare them offline.

Read and write bags
  storage.read              a bag as columns and values; needs no ROS
  storage.invalid_messages  drop the messages that break the contract
  storage.bag_writer        write a bag in the layout of rosbag2
  storage.repair            rebuild a bag that was cut off or damaged
  playback                  which message is sent when; a clock that pauses, steps and seeks

Evaluate a run
  evaluation.drive          one run as arrays, from a bag or from columns
  evaluation.series         distances and angles of a drive, sample by sample
  evaluation.metrics        the metrics of a drive; how to add one
  evaluation.tick_timing    latency and deadline misses of the controller
  evaluation.bag_summary    contents, gaps, losses and timing of a bag

Compare runs
  report.comparison         table, JSON, CSV, figures and report.html of several runs
  figures                   Matplotlib figures
  viewers                   markers and a server for Foxglove

The command `bags` and the nodes recorder_node, player_node, markers_node and view_node are built
from these. Nothing here imports a controller. docs/bags.md, docs/report.md and docs/viewers.md
are the manuals.
"""
