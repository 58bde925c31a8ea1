"""Batches: every combination of scenarios, controllers, settings, draws and runs; rows per drive.

study_file  the YAML file that says what is varied; distributions and their Sobol points
run_batch   the rows of a study, with paired draws and start offsets, checked and driven
"""
