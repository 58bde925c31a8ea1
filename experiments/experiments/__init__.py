"""Everything that drives: one run, runs again, studies, tuning, and the paper's claims."""
