"""Tables of drives, read by a person: of `experiments batch`, `library`, and others of their form.

drive_table      a table of drives, its metrics, and the columns that tell drives apart
marginals        a metric over the values of columns: medians, shares, differences of controllers
success_surface  the share in which a condition holds, as a smooth function of two columns
result_figures   all of these as figures
"""
