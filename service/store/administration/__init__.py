"""What ``stemwatch db`` does: check, prune, back up, restore and copy a database."""
