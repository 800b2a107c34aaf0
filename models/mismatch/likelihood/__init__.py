"""The likelihood of a recording by a stem whose breakaways scatter."""
