"""What ``stemwatch db`` does: migrate, check, prune, back up, restore and copy a database."""
