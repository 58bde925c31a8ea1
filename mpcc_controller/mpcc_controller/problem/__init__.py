"""The optimal control problems.

formulation             the interface of a formulation; their list: `parameters.FORMULATIONS`
mpcc_formulation        the paper's MPCC, and trajectory tracking
frenet_formulation      the baseline, in path coordinates
cost_terms              the one list of cost terms, with their weights and what is refused
ocp                     constraints, the stage problem of a formulation, evaluation of plans
stage_parameters        path, road, obstacles and parameters as numbers per stage
time_gaps               who is ahead of a plan, to whom a gap in time is kept
obstacle_motion         discs of obstacles over the horizon: at constant velocity or on a course
distance_frame          where distances are measured: Cartesian or path coordinates
bounds                  limits of actuators, speed and friction
problem_check           refuses functions that are not finite where the car may be
"""
