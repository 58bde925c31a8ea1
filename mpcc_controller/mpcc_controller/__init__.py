"""Model predictive control of a car at the limit of handling: the paper's MPCC and its baseline.

controller_node   the node; mpcc_node and frenet_node differ in their default parameters
controller_inputs_node
                  its subscriptions: messages are checked, then used or rejected
parameters        every parameter, with unit and allowed range; values are in config/
run_time_parameters
                  weights and limits that may be changed between two steps
car_file          the car as the controller knows it, and the limits of its actuators
in_force          the parameters that a controller drives by: limits, speeds, circles
driving           one command per state: planner, fallbacks, safety gate, watchdog; no ROS
problem           the optimal control problems: formulations, cost terms, constraints
path              the coarse path, road edges, distances, path coordinates
model             the prediction model: nonlinear single track with Fiala tyres

Start reading at `driving.tick.tick`.
"""
