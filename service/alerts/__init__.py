"""From the findings of runs to messages that people get.

``rules`` decides which findings of one valve are worth an alert; ``evaluate`` applies the rules
after a run; ``one_per_cause`` joins the alerts of one valve, ``common_cause`` those of several;
``silent_sources`` and ``dead_tags`` watch the sources between runs; ``digest`` writes one message
about all new alerts; ``sender`` hands it to the ``notifiers`` until it has arrived.
"""
