"""Studies: the controllers compared over many paired runs in process.

The parts of `experiments study`:
    metric_distributions  every metric over paired runs
    ablation              single factors switched
    limit                 the share of cleared runs over the entry speed
    claims                the claims of the paper as rules
    claim_evaluation      their verdicts and causes
    demand                the lateral acceleration that a scenario demands

Common to all parts:
    variants              the controllers and their switched factors
    run_spec              one run: draw, setup, results
    runner                many runs in parallel, cached
    run_statistics        shares, medians, the median run
    tables                Markdown, CSV and JSON with provenance
    code_version          the digest of the code that decides a run
    success_curve         where shares fall over the speed
    undisturbed_run       planned intrusions and distance errors of one run
    study_figures         the figures
"""
