"""The command that simulates a ventricle."""
