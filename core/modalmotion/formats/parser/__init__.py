"""A process of its own for parsers that damaged files can crash."""
