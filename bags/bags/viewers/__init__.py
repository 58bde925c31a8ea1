"""The car and its plan for RViz and Foxglove.

marker_scene  car, safety areas and plan as markers, which markers_node sends
"""
