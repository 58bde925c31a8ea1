"""The study of tuned controllers: both tuned alike, judged on fresh tasks (docs/study.md).

arms       the controllers, as rows
search     the search for the weights of an arm
outcome    what the tables hold of a drive
driver     drives rows, keeps a line of the table for each
run        replicates: search, judge; the draws of the picture
picture    which unprinted parameters make the paper's picture
analysis   estimands, intervals, verdicts
verdicts   intervals over replicates, and the rules that decide
figures    a figure for each
report     both, as `experiments study decide` writes them
"""
