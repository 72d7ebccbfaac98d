"""Answers: the class that a model gives to one motion, and why."""
