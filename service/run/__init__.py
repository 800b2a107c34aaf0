"""One engine for every run: a request becomes tasks, tasks become results, results a report.

``plan`` decides which valve is read from where, ``execute`` screens in any executor and saves each
result, ``finish`` controls false discoveries and writes report and work list. ``engine`` puts them
together; ``queue_worker`` processes the queue.
"""
