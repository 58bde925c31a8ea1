"""Batches: every combination of scenarios, controllers, settings, draws and runs; rows per drive.

distributions  of drawn values, and their scrambled Sobol points
study_file     the YAML file that says what is varied
study_rows     the rows of a study; paired draws and start offsets
run_batch      all of that, in parallel, to be interrupted at any time
"""
