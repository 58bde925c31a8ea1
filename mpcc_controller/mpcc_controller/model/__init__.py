"""The prediction model.

single_track            states, inputs, equations of motion, axle loads, brake split
fiala                   the tyre
stability               from which speed on a step of the prediction is stable
"""
