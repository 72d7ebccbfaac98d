"""Files on disk: written whole, moved together, locked."""
