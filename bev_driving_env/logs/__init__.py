"""Drive logs: states of recorded drives, from which all that was seen is rendered again."""
