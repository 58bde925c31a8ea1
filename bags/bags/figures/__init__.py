"""Figures with Matplotlib.

style                  colours, fonts and line styles; save a figure as PNG and SVG
comparison_figures     the sheet of a comparison, and each of its panels singly
panels                 the panels against the station
frame_distance_figure  the paper's first experiment
"""
