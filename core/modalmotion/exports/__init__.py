"""Exports: surfaces, animations and packs for other programs."""
