"""A result as one page for people: HTML that fetches nothing, with figures inside."""
