"""What each limit of a verdict and each alert rule means, in the words of docs/plant-file.md."""

from __future__ import annotations

LIMIT_WORDS = {
    "watch_S_percent": "S from which a valve is watched, percent of OP span",
    "sticky_S_percent": "S that the low end of its interval must reach for a valve to be sticky",
    "min_reversals": "reversals of OP, larger than its noise, that a verdict needs",
    "min_samples_per_cycle": "samples per cycle of OP's own movement",
    "min_duration_s": "shortest recording, seconds; 0: 300 samples, however long they take",
    "min_samples": "fewest usable pairs of OP and MV",
    "max_bad_share": "largest share of unusable pairs",
    "max_interpolated_share": "largest share of moving samples that the historian interpolated",
    "fitted_samples": "of a record more than twice as long, only the stretch of so many samples "
    "that tells most is fitted",
    "min_fit_percent": "held-out fit below which S and J describe nothing",
    "baseline_ratio_watch": "times worse than in its baseline window at which a valve is watched",
}
RULE_WORDS = {
    "raise_after_runs": "in how many of the last of_runs runs with a verdict a finding must be",
    "of_runs": "",
    "clear_after_runs": "after how many runs in a row without the finding an alert is closed, at "
    "least",
    "grown_S_percent": "growth of S, in percent of OP span, that is worth an alert",
    "foreseen_within_weeks": "an alert is raised when a valve will probably stick within so many "
    "weeks",
    "sticking_suspected": "whether a suspicion from OP and PV alone raises an alert",
    "silent_after_s": "seconds without a good sample after which a device is silent",
    "common_valves": "this many valves of an area, unit or source with the same finding become one "
    "alert",
    "common_share": "if they are also at least this share of its valves",
}
