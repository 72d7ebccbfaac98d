"""Makes the service's routes where it is imported: before a fork, for all that are forked."""

from __future__ import annotations

from pathlib import Path

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

create_app(Settings(data_dir=Path("nowhere"))).openapi()
