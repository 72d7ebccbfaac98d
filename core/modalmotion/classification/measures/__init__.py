"""Figures of a classifier's answers to labelled cases, with their intervals."""
