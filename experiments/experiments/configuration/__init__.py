"""Configuration of a run: scenario, controller and parameters of every node.

node_config     the nodes of a run and their parameters
inputs          scenario and parameters, checked before a run
run_advice      what is rarely meant in them, with numbers
parameter_list  what can be set, with unit, range, default and meaning
set_option      the option `--set` of runs and replays
"""
