"""Modal signatures: making, reading, comparing, superposing them."""
