"""Networks beside the stiction models: trained and marked on a recording by one call."""
