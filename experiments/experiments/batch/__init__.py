"""Batches: every combination of scenarios, controllers, settings, draws and runs; rows per drive.

distributions  of drawn values, and their scrambled Sobol points
study_file     the YAML file that says what is varied
drive_plan     the drives of a study, their setups and keys; paired draws and perturbations
run_spec       how a further run differs from the first, what decides it, what is kept of it
simulate       one drive, in a worker
drive_records  finished drives, kept one by one, with progress on the console
results_table  rows as Parquet, and their summary
run_batch      all of that, in parallel, to be interrupted at any time
"""
