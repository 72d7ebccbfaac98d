"""Commands that the service adds to the command line."""

from typing import Final

LINES: Final = {
    "audit": "Read the audit log.",
    "keys": "Create, list and revoke the keys of a service.",
    "owners": "List the data of each owner, or remove an owner with all data.",
    "serve": "Start the HTTP service; its documentation is at /docs.",
    "settings": "Show every setting: its variable, value, default and meaning.",
}
"""One line for each, read for the help of all without an import of any."""
