"""Figures with Matplotlib.

style                  colours, fonts and line styles; save a figure as PNG and SVG
comparison_figures     the sheet of a comparison, and each of its panels singly
film                   runs as GIF or MP4
film_strip             one run of a film
overlay                curves from a CSV file beside those of the runs
panels                 the panels against the station
frame_distance_figure  the paper's first experiment
"""
