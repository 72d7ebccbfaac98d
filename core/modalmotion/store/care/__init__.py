"""Care of a store: backup, rebuild, recovery, verification."""
