"""From what runs find to somebody who hears of it.

``rules`` says what is worth raising in the screenings of one valve; ``evaluate`` applies them after
a run and joins what has one cause; ``silence`` watches the sources between runs; ``digest`` makes
one message of all that is new; ``sender`` brings it to the ``notifiers`` until it has arrived.
"""
