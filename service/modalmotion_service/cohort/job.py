"""A run over a cohort: what is asked of it, and its outcome."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from modalmotion.formats import ReadOptions
from modalmotion.signature.making import SignatureParameters
from modalmotion_service.cohort.manifest import Entry
from modalmotion_service.cohort.remote import Source


@dataclass(frozen=True)
class CohortJob:
    """Files and options of a run over a cohort.

    Parameters
    ----------
    entries : tuple of Entry
    folder : Path
        The result store that signatures go to.
    parameters : SignatureParameters
    options : ReadOptions
    template_from : Path or None
        Sequence whose reference gives one template for all: their vertices must correspond.
    keep_vertices : bool
        Whether the store keeps the sequences too.
    batch : int or None
        Files in one piece of work; depends on their number by default.
    max_file_bytes : int
        Largest file that is fetched from elsewhere.
    patience_seconds : float
        How long to wait for a lost scheduler before giving up.
    """

    entries: tuple[Entry, ...]
    folder: Path
    parameters: SignatureParameters = field(default_factory=SignatureParameters)
    options: ReadOptions = field(default_factory=ReadOptions)
    template_from: Path | None = None
    keep_vertices: bool = False
    batch: int | None = None
    max_file_bytes: int = 256_000_000
    patience_seconds: float = 120.0


@dataclass(frozen=True)
class CohortReport:
    """Outcome of a run over a cohort.

    Parameters
    ----------
    n_made, n_known : int
        Files done now, and those that an earlier run had done.
    failures : tuple of (Path or RemoteFile, str)
        File and reason, in the order of the manifest.
    seconds : float
    """

    n_made: int
    n_known: int
    failures: tuple[tuple[Source, str], ...]
    seconds: float
