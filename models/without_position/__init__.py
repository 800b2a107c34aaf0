"""What OP and PV alone tell of a valve without a measured position: a suspicion, no verdict."""
