"""The multi-body model of CommonRoad as a second plant, behind the interface of the double track.

symbolic    a Python function of numbers, evaluated on CasADi symbols
equations   inputs, states, derivative and outputs of the model; start of a run
"""
