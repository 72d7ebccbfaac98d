"""Choice of the modes: nested sets, their errors, the measurement's noise, simple scenes."""
