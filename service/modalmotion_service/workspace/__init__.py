"""The workspace of one owner: store, spool, jobs, models, analysis."""
