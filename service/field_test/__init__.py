"""The test that would tell, for people: the plan of a valve, its sheet as text, HTML, PDF, JSON."""
