"""The planned field test of a valve, and its sheet for the operator as text, HTML, PDF and JSON."""
