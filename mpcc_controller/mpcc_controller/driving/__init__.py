"""From state to command, once per tick. No ROS.

controller           `step(TickInputs) -> TickRecord`: the whole tick
tick                 inputs and record of a tick
tick_report          explains a record: /controller/why and the predicted poses
planner              initial guess, stage parameters, bounds and solvers of one plan
initial_guess        the last plan shifted by a tick, or the path
solver_selection     which solvers run, and for how long
fallback             what to drive when a solve fails
braking              braking along the last plan or the path, without optimisation
setpoints            set-points of the actuators, and commands
delay_compensation   predicts the state to the effect of its command
gate                 the last check of a command
trigger              which states are answered
watchdog             ages of the inputs, and the health of the controller
"""
