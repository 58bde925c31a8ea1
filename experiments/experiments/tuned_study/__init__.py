"""The study of tuned controllers: both tuned alike, judged on fresh tasks (docs/study.md).

plan       what was fixed beforehand, in study.yaml, checked
arms       the controllers, as rows; drives them, and what the tables hold of a drive
search     the search for the weights of an arm
run        replicates: search, judge; the draws of the picture; the tables
analysis   estimands, from the tables, and the rules that were fixed beforehand
picture    which unprinted parameters make the paper's picture
exchange   why both controllers differ in a task
report     all of it, with a figure for each estimand, as `experiments study decide` writes it
"""
