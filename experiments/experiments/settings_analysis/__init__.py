"""The analysis of the study over many settings.

setting_statistics  bootstrap over settings, exact bounds, Holm's correction, equivalence
verdicts            a claim among the settings of a precondition level
factorial           effects of the factors that separate baseline and MPCC
surrogate           which dimensions drive an outcome
"""
