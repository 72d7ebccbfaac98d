"""Settings, read from the environment (MODALMOTION_...) when the app is made."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from modalmotion.formats import ReadLimits


class Settings(BaseSettings):
    """What an operator may choose."""

    model_config = SettingsConfigDict(env_prefix="MODALMOTION_", frozen=True)

    data_dir: Path = Field(Path("modalmotion-data"), description="Folder that results lie in.")
    keep_uploads: bool = Field(True, description="Whether uploaded vertices are kept.")
    max_body_bytes: int = Field(256_000_000, gt=0, description="Largest request body.")
    max_frames: int = Field(10_000, gt=0, description="Most frames in a sequence.")
    max_vertices: int = Field(2_000_000, gt=0, description="Most vertices in a frame.")
    max_faces: int = Field(4_000_000, gt=0, description="Most triangles in a mesh.")
    max_decompressed_bytes: int = Field(
        1_000_000_000, gt=0, description="Largest total of the arrays in an upload."
    )

    @property
    def read_limits(self) -> ReadLimits:
        """Limits that every reader of uploads applies."""
        return ReadLimits(
            frames=self.max_frames,
            vertices=self.max_vertices,
            faces=self.max_faces,
            decompressed_bytes=self.max_decompressed_bytes,
        )
