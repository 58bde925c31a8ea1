"""The study of tuned controllers: both tuned alike, judged on fresh tasks (docs/study.md).

arms       the controllers, as rows
search     the search for the weights of an arm
outcome    what the tables hold of a drive
run        a replicate: search, judge, keep every row
analysis   estimands, intervals, verdicts
figures    a figure for each
"""
