"""Batches: every combination of scenarios, controllers, settings, draws and runs; rows per drive.

distributions  of drawn values, and their scrambled Sobol points
study_file     the YAML file that says what is varied
run_batch      the rows of a study, with paired draws and start offsets, checked and driven
"""
