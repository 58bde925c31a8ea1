"""Figures with Matplotlib.

style               colours, fonts and line styles; save a figure as PNG and SVG
comparison_figures  the sheet of a comparison, and each of its panels singly
film                runs as GIF or MP4
scene               a run from above as shapes, for figures, film, page and markers
overlay             curves from a CSV file beside those of the runs
frame_distances     the paper's first experiment: the distance in Frenet and Cartesian coordinates
"""
