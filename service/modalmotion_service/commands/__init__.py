"""Commands that the service adds to the command line."""

from typing import Final

LINES: Final = {
    "audit": "Read the record of who did what.",
    "keys": "Make, list and take back the keys that open a service.",
    "owners": "See what each owner has, and remove one with everything.",
    "serve": "Start the HTTP service; its documentation is at /docs.",
    "settings": "Show every setting: its variable, value, default and meaning.",
}
"""One line for each, read for the help of all without an import of any."""
