"""Answers: what a model says of one motion, and why."""
