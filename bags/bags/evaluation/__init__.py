"""Evaluate runs; shares no code with the controllers and the plant that drove them.

drive            one run as arrays: motion, inputs, ticks, scene, parameters
geometry         polylines, circles and the outline of the car, in plain numpy
vehicle_shape    outline and circles of the car, from the parameters of a run
series           distances and angles of a drive, sample by sample
metrics          the numbers by which runs are compared, and how to add one
signals          derived signals on the time base of the odometry, and how to add one
flattening       nested values by dotted name
descriptions     what was driven and by whom, in words
tick_timing      latency, parts of a tick, deadline misses
controller_log   reports, predictions, compared plans and answered states of the controller
bag_summary      contents, losses and timing of a bag
frame_distances  the distance to an obstacle in Frenet and Cartesian coordinates (experiment 1)
"""
