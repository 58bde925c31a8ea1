"""Recorded drives of real cars, or of the plant: what they say about the controllers' car.

log_map           which column of a file is which signal, in which unit; what is known of the car
measured_log      a log of any format in SI units at the CoG, filtered, without what is wrong in it;
                  refused where signs, units and signals contradict each other
single_track_fit  the single track over many windows at once, and its fit with intervals
validation        errors of prediction model and plant against a log
report            the car file and table of a fit; tables, figure and numbers of a validation
"""
