"""Evaluate runs; shares no code with the controllers and the plant that drove them.

drive         one run as arrays: motion, inputs, ticks, scene, parameters; its distances and angles
geometry      polylines, circles and the outline of the car, in plain numpy
metrics       the numbers by which runs are compared, and how to add one
signals       derived signals on the time base of the odometry, and how to add one
bag_summary   contents, losses and timing of a bag: latency, parts of a tick, deadline misses
"""
