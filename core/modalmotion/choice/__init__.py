"""How many modes serve: nested sets, their errors, the measurement's noise, simple scenes."""
