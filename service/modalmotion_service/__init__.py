"""HTTP service around modalmotion."""

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

__all__ = ["Settings", "create_app"]
