"""The prediction model.

single_track            states, inputs, equations of motion, axle loads, brake split
fiala                   the tyre
elementary_functions    sin, cos, sqrt for numbers and CasADi expressions
"""
