"""A moving surface in a browser: what is sent to the page, and the page as one file."""
