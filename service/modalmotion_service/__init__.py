"""HTTP service around modalmotion."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from modalmotion_service.app import create_app
    from modalmotion_service.settings import Settings

__all__ = ["Settings", "create_app"]


def __getattr__(name: str) -> object:
    """Import a public name (PEP 562): the help of a command needs none of them."""
    if name == "create_app":
        from modalmotion_service.app import create_app

        return create_app
    if name == "Settings":
        from modalmotion_service.settings import Settings

        return Settings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
