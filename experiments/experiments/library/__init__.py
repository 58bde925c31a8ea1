"""Drives through the families of emergencies and the entries of the library, and who survived.

library_drive    one draw or entry by one controller: its setup, its key, its results
run_library      all of them, in parallel, to be interrupted at any time; the table
survival_table   survived per family and controller with intervals, and the causes of the others
catalogue        families and entries listed, chosen, written as files and drawn
scenario_figure  a picture of a scenario
"""
