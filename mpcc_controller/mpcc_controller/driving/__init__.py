"""From state to command, once per tick. No ROS.

controller           holds memory and inputs between ticks; `step(TickInputs) -> TickRecord`
tick                 the whole tick, pure: (memory, inputs, scene, parts) -> (memory, record)
parts                what ticks work with: parameters, and what is built from them
records              inputs, record and memory of a tick
tick_report          explains a record: /controller/why and the predicted poses
planner              one plan: which guess, which problems, which solution, what fallback
prediction_model     parameters, car and formulation of the plans; the problem of a tick
path_progress        theta of stage 0: where on the path the car is
tick_solvers         solves the problems of a tick, in parallel
parallel_solves      several solves at once, in threads
ways                 dangerous obstacles ahead, the ways around them, how a plan passes them
guesses              initial guesses: last plan, path, control law, ways, braking
choose               which plans a tick compares, which is driven, which are kept
fallback             what to drive when a solve fails
recovery             counter-steers a car that slides without a plan
braking              braking along the last plan or the path, without optimisation
last_resort          after an internal error: counted; braking that shares nothing with the tick
stop_plan            set-points that stop the car when no command follows
actuator_monitor     compares measured actuators with set-points
actuator_faults      what is planned and sent while actuators do not follow
late_setpoints       how late set-points arrive, from where the actuators were
setpoints            set-points of the actuators, and commands
friction_estimate    friction of the road from the motion of the car
obstacle_prediction  obstacles from messages to predictions: hypotheses by likelihood
obstacle_tracks      motion and existence of obstacles, from message to message
measurement_errors   errors added to what is received, a test option
delay_compensation   predicts the state to the effect of its command
gate                 the last check of a command
trigger              which states are answered
watchdog             ages of the inputs, and the health of the controller
"""
