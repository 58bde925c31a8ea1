"""From state to command, once per tick. No ROS.

controller           `step(TickInputs) -> TickRecord`: the whole tick
tick                 inputs and record of a tick
tick_report          explains a record: /controller/why and the predicted poses
planner              initial guess, stage parameters, bounds and solvers of one plan
tick_problem         the optimal control problem of a tick
candidates           dangerous obstacles, and initial guesses on their sides
candidate_plans      which candidates a tick solves, and which plans are kept for the next
candidate_choice     which of the solved candidates is driven
parallel_solves      several solves at once, in threads
initial_guess        the last plan shifted by a tick, or the path
solver_selection     which solvers run, and for how long
fallback             what to drive when a solve fails
recovery             counter-steers a car that slides without a plan
braking              braking along the last plan or the path, without optimisation
setpoints            set-points of the actuators, and commands
friction_estimate    friction of the road from the motion of the car
obstacle_memory      obstacles that vanish for a moment
measurement_errors   errors added to what is received, a test option
warm_up_scene        an obstacle ahead, for a controller that warms up
delay_compensation   predicts the state to the effect of its command
gate                 the last check of a command
trigger              which states are answered
watchdog             ages of the inputs, and the health of the controller
"""
