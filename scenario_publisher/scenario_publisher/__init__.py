"""Scenarios: road, coarse path, obstacles and friction from one YAML file, and their ROS node.

Use:
    scenario          load a scenario by name or file; obstacles at an instant
    timeline          messages of a scenario under a stamp, and their rates
    scenario_node     the ROS node
    converter_node    the ROS node of perceived_objects: those of other programs, converted
From file to scenario:
    schema            every key of the file with its range and unit
    lines             straights, arcs, clothoids, lane changes, splines; sampled lines
    polyline          distances to polylines
    road_geometry     sampled lines and road edges of the file
    friction_patches  stripes of another friction as quadrilaterals
    actors            obstacles over time; waypoint_track those along way-points
    sight             which of them are seen, and the speed that allows
    expectations      what a scenario expects of a run
    plausibility      checks of path, start, finish and obstacles
    advice            what is allowed but rarely meant
"""
