"""The study of tuned controllers: both tuned alike, judged on fresh tasks (docs/study.md).

plan       what was fixed beforehand, in study.yaml, checked
arms       the controllers, as rows
search     the search for the weights of an arm
outcome    drives rows, and what the tables hold of a drive
run        replicates: search, judge; the draws of the picture; the tables
verdicts   intervals, and the rules that were fixed beforehand
analysis   estimands, from the tables
picture    which unprinted parameters make the paper's picture
exchange   why both controllers differ in a task
figures    a figure for each estimand
report     all of it, as `experiments study decide` writes it
"""
