"""Connectivity of a mesh as bits."""
