"""The science: from a valve's ``Recording`` to its verdict and health indicators. No I/O.

``screening`` has all of it on one page. On the way a recording is made ready (``preparation``) and
checked (``record_checks``), fitted (``stickslip``, ``narx``), explained where the fit fails
(``mismatch``), judged (``decision``) and put into numbers (``health_indicators``). Where no
position is measured, ``without_position`` looks for signs.
"""
