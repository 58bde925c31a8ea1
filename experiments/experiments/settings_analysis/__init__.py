"""The analysis of the study over many settings: verdicts, causes, drivers, existence.

setting_statistics  bootstrap over settings, exact bounds, Holm's correction, equivalence
verdicts            a claim among the settings of a precondition level
factorial           effects of the factors that separate baseline and MPCC
surrogate           which dimensions drive an outcome
study_tables        the tables of a study as data frames
decide              all of that for one study
decision_figures    its figures
decision_report     its files
who_avoids          in which settings each controller avoids
early_braking       who brakes when, and what comes with it
dimension_shares    how often something happens over each dimension
outcome_figures     figures of who avoids and who brakes
outcome_report      their files, and what they say in pages
accepted_rows       the drives that the claims rest on, kept and decided again
published           every block of a page about the study
sensitivity         what else the tables say, which enters no verdict
picture             the paper's picture as numbers, and the distance from it
picture_search      the search for the setting that is nearest to it
pictures_of_study   where that search begins
existence           what was found, judged by fresh drives; the rule for the demo
existence_report    its files
baseline_tuning     the tuned version of the baseline
tuned_table         its parameters by setting
run_decision        the commands
"""
