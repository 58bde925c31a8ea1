"""Families of emergencies: seeded random draws, each a scenario file. Pure geometry.

draw               (family, seed, index, difficulty) -> Draw, independent of every other draw
scenario_document  the parts of a scenario document: roads, cars, walkers, start and finish
feasibility        closed forms that say whether a draw can be mastered: nominal draws are
emergencies        what appears, comes or crosses; bends, slaloms, gates, lane changes
traffic            other road users on roads that bend
lane_change_task   tasks of the study of tuned controllers, and the curvature that they demand
plant_variant      their plants, and the cars identified on them
"""
