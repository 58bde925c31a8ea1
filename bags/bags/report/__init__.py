"""Compare runs: table, JSON, CSV, figures and an HTML report that needs no network.

comparison     compare bags, or runs, and write all results
comparability  refuse runs of different scenarios or plants; what drove, and its provenance
page           report.html, with its panels and its film of the manoeuvre
"""
