"""From the findings of runs to messages that people get.

``rules`` decides which findings of one valve are worth an alert; ``evaluate`` applies the rules
after a run and joins alerts with a common cause; ``silent_sources`` and ``dead_tags`` watch the
sources between runs; ``digest`` writes one message about all new alerts; ``sender`` hands it to the
``notifiers`` until it has arrived.
"""
