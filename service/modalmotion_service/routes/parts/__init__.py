"""Parts that routes share."""
