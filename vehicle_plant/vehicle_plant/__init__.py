"""The car as the controller's plant: double-track model at 1 kHz, and its ROS 2 node.

Use:
    simulator           the plant as an object that is advanced by commands
    parameters, car     parameter files of cars and the node; parameters of the car
    identify            car and Fiala tyre parameters for the controllers, from circular driving
    manoeuvre           drive a standard test procedure of `manoeuvres`, which are beside
    linear_single_track closed forms of small steering to compare with
    plant_node          the ROS node, with its two modes in modes_node, its /tf in frames_node
    robot_description   the car as URDF
Model:
    double_track        equations of motion; suspension, wheel and tyre are its parts
    actuators           servos, and what they are given of the set-points: delays, faults
    multi_body          those of the multi-body model of CommonRoad, in their place
    state               state, inputs and outputs as named vectors; trajectories
    road_friction       patches of another friction
    sensors             what the car measures of its motion
    tyre_coefficients, tyre_property_file   Magic Formula tyres, from YAML or .tir
    integrator          Runge-Kutta steps in compiled C
Run:
    initial_state       start of a run
    stepping            when the plant advances: lockstep, realtime, silent controller
    gate                last check of a command
    run_end             finish line, time limit, standstill
    health              /diagnostics
    circular_driving    quasi-steady circular driving, ISO 4138
"""
