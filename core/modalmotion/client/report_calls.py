"""Reports: for people, for systems, for statistics, for an archive."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import CSV, Calls, require_place, require_suffix, save, sequence_path
from modalmotion.client.connection import Call
from modalmotion.client.query import Option
from modalmotion.progress import Progress

ZIP: Final = "application/zip"

REPORT_FILES: Final = {".pdf": "application/pdf", ".json": "application/fhir+json", ".csv": CSV}
"""Media types of reports by suffix."""


class ReportCalls(Calls):
    """Reports on stored sequences."""

    def save_report(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a report to .pdf for people, to .json as FHIR R4, or to .csv, a row a frame.

        Parameters
        ----------
        sequence_id : str
        path : str or Path
        **options
            model, whose kept classification is reported; and those of the signature.
        """
        target = Path(path)
        accept = require_suffix(target, REPORT_FILES)
        save(self._get(sequence_path(sequence_id, "report"), options, accept).content, target)

    def save_tracked_report(
        self, source: Source, path: str | Path, *, progress: Progress | None = None, **options: Any
    ) -> None:
        """Track a surface through images, points or contours, and write a zip of its report.

        It has the report for people, for systems and for statistics, and a page to look at. The
        track and the class are stored.

        Parameters
        ----------
        source : path or bytes
            As for `make_track`.
        path : str or Path
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            model; and those of `POST /v1/tracks`, such as apex="1,2,3".

        Raises
        ------
        RemoteError
            If it cannot be tracked.
        """
        target = Path(path)
        require_place(target)
        call = Call("POST", "/v1/reports", options, ZIP, body_of(source), is_keyed=True)
        save(self._sent(call, lambda answer: answer.content, progress), target)

    def save_dicom(
        self, sequence_id: str, study: bytes | Path, path: str | Path, **options: Option
    ) -> None:
        """Write a zip of DICOM objects of a patient's study: a structured report and surfaces.

        Parameters
        ----------
        sequence_id : str
        study : bytes or Path
            Any instance of the study.
        path : str or Path
        **options
            As for `save_report`.

        Raises
        ------
        RemoteError
            If the sequence's coordinates are not stated to be LPS, in mm.
        """
        target = Path(path)
        require_place(target)
        call = Call(
            "POST",
            sequence_path(sequence_id, "dicom"),
            options,
            ZIP,
            body_of(study),
            is_repeatable=True,
        )
        save(self._connection.send(call).content, target)
