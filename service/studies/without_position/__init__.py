"""What OP and PV alone tell of a valve, counted on simulated loops; and the training for it."""
