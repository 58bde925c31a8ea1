"""The results of the paper, reproduced by one command: figures, tables and claims.

reproduction     both experiments, distributions and claims; the claims in a page
operating_point  reference numbers of single runs, tracked and checked by tests
"""
