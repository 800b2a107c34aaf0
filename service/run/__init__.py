"""One engine for every run: what is asked becomes tasks, tasks become results, results a report.

``plan`` says which valve is read where, ``execute`` has it screened in any executor and saves it as
it comes, ``finish`` decides what stands and writes report and work list. ``engine`` shows it on one
page; ``queue_worker`` does the runs of the queue with it.
"""
