"""Configuration of a run: scenario, controller and parameters of every node.

node_config  the nodes of a run and their parameters
inputs       scenario and parameters, checked before a run; warnings about mismatches
set_option   the option `--set` of runs and replays
"""
