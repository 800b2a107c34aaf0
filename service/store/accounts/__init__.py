"""Users, one-time links, browser sessions, API tokens and the audit log, as stored."""
