"""What is to be screened when: schedules, the queue of runs, and which process has which duty."""
