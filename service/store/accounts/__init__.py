"""Who may do what: users, one-time links, browser sessions, tokens, and the audit log."""
