"""``python -m stemwatch.service`` is the command ``stemwatch``."""

from stemwatch.service.cli import main

main()
