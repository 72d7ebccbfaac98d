"""Tests of models on labelled cases, and comparisons of two."""
