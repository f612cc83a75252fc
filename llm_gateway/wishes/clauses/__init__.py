"""Tells, clause by clause, what a wish says of what it names."""
