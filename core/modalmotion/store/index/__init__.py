"""The index of a store in SQLite."""
