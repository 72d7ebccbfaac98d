"""Models: trained estimators with their card, domain and conformal sets, and their file."""
