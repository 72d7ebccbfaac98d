"""Estimators in the form of scikit-learn: features to class probabilities."""
