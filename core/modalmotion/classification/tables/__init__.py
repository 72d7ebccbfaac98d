"""Features of a cohort as a table."""
