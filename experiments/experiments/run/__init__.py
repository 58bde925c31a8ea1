"""Runs of the node graph.

run_and_compare   `experiments run`: several controllers, then the comparison, with earlier runs too
run_file          a run written down as YAML
node_graph        one run: start, watch, stop, keep the bag
compile_ahead     compiles controllers beside the first run
processes         programs and nodes as processes; signals as flags
staging           hidden folders in which runs are recorded
live_position     position of the car in a growing bag
domain            reservation of a ROS domain
launch_arguments  arguments of the launch file, and the parameter files that it takes
"""
