"""Drives through the families of emergencies and the entries of the library, and who survived.

run_library      the rows of draws or entries, driven in parallel, to be interrupted at any time
survival_table   survived per family and controller with intervals, and the causes of the others
catalogue        families and entries listed, chosen and written as files
"""
