"""Compare runs: table, JSON, CSV, figures and an HTML report that needs no network.

comparison          compare bags, or runs, and write all results
comparability       refuse runs of different scenarios or plants; provenance of each run
page                report.html
interactive_panels  its panels as Bokeh figures
animation           its animation of the manoeuvre
"""
