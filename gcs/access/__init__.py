"""Who may do what: roles, tokens in a file, links that show one flight, and the log of who did what."""
