"""Stored sequences, images and tracks, and what files said."""

import math
from dataclasses import asdict
from typing import Any, Literal

import numpy as np

from modalmotion import store, tracking
from modalmotion.representation import Floats
from modalmotion.tracking.result import ImageAnswer
from modalmotion_service.schemas.from_core import Answer, Paged, mirrors, read_from
from modalmotion_service.schemas.general import FactsAnswer, ReadingAnswer
from modalmotion_service.schemas.signatures import Label


@mirrors(store.SequenceRecord, without=["has_upload", "span"])
class SequenceSummary(Answer):
    """Summary of a stored sequence."""

    facts: FactsAnswer
    reading: ReadingAnswer | None = None
    """How the upload was read; only in the answer to it."""
    links: dict[str, str]

    @staticmethod
    def of(record: store.SequenceRecord, reading: ReadingAnswer | None = None) -> "SequenceSummary":
        """Summarise a record of the store."""
        here = f"/v1/sequences/{record.id}"
        return read_from(
            SequenceSummary,
            record,
            facts=FactsAnswer.of(record.facts),
            reading=reading,
            links={
                "self": here,
                "signature": f"{here}/signature",
                "signatures": f"{here}/signatures",
                "classifications": f"/v1/signatures/{record.id}/classifications",
            },
        )


class SequencePageAnswer(Paged):
    """A page of the list of sequences."""

    sequences: list[SequenceSummary]


@mirrors(store.ImagesRecord)
class ImagesSummary(Answer):
    """Images over time, in LPS mm."""

    kind: Literal["volumes", "planes"]
    apex: list[list[float] | None]
    base: list[list[float] | None]
    links: dict[str, str]

    @staticmethod
    def of(record: store.ImagesRecord) -> "ImagesSummary":
        """Summarise a record."""
        here = f"/v1/images/{record.id}"
        links = {"self": here, "track": f"/v1/tracks?images={record.id}"}
        return ImagesSummary(**asdict(record), links=links)


class ImagesPageAnswer(Paged):
    """A page of the list of images."""

    images: list[ImagesSummary]


@mirrors(ImageAnswer, without=["slope", "shift_sd", "localisation", "bent", "volume_correlation"])
class ImagesEstimate(Answer):
    """What was found of images that were tracked."""

    ejection_fractions: dict[str, float]
    """Under both conventions, percent."""
    shift_deviation: float
    """Of a shift along one axis, mm."""

    @staticmethod
    def of(track: tracking.Track) -> "ImagesEstimate | None":
        """Write out what a track says of its images; None of one without."""
        own = track.images
        if own is None:
            return None
        return read_from(
            ImagesEstimate,
            own,
            ejection_fractions=track.ejection_fractions,
            shift_deviation=own.shift_sd,
        )


@mirrors(
    tracking.Track,
    without=[
        *("sequence", "template", "amplitudes", "covariances", "prior", "deviations"),
        *("residuals", "provenance", "data"),
    ],
)
class TrackEstimate(Answer):
    """What was found, and how well; lengths in the unit of the sequence."""

    modes: list[Label]
    noise: float
    """Standard deviation of a point."""
    residual_rms: list[float | None]
    """Of each frame, of the points that counted; null without any."""
    residual_p95: list[float | None]
    deviation_across: list[float]
    """Of each frame: standard deviation of a vertex across the surface, RMS."""
    deviation_along: list[float]
    """The same in each direction along it, where the prior speaks."""
    determined: list[list[float]]
    """Share of each mode that the data have set, across the surface and along it; below 0.5 it is
    the prior's."""
    volumes: list[float] | None
    """Cubed unit; null of what encloses none."""
    ejection_fraction: float | None
    """Share of the largest volume that the smallest lacks, percent."""
    ejection_fraction_bound: float | None
    """Two standard deviations, percentage points."""
    times: list[float] | None
    """In s."""
    images: ImagesEstimate | None
    """Null where points were tracked."""
    parameters: dict[str, Any]
    """As they were used."""

    @staticmethod
    def of(track: tracking.Track) -> "TrackEstimate":
        """Write a track out, without its surfaces and amplitudes."""
        rms = np.sqrt(np.mean(track.deviations**2, axis=1))
        return read_from(
            TrackEstimate,
            track,
            modes=track.modes.labels,
            noise=track.noise.sd,
            residual_rms=_with_null(track.residuals[:, 0]),
            residual_p95=_with_null(track.residuals[:, 1]),
            deviation_across=rms[:, 0].tolist(),
            deviation_along=rms[:, 1].tolist(),
            times=None if track.sequence.times is None else track.sequence.times.tolist(),
            images=ImagesEstimate.of(track),
            parameters=dict(track.provenance),
        )


class TrackSummary(Answer):
    """A track, and the sequence that it made, which has the same id."""

    id: str
    """That of the sequence."""
    sequence: SequenceSummary
    links: dict[str, str]


class TrackAnswer(TrackEstimate, TrackSummary):
    """A track: its sequence, and what was found besides."""

    @staticmethod
    def joined(
        estimate: TrackEstimate, record: store.SequenceRecord, images_id: str | None
    ) -> "TrackAnswer":
        """Add to what was found the record of its sequence, and the images that were kept."""
        summary = _summary(record)
        if images_id is not None:
            summary["links"]["images"] = f"/v1/images/{images_id}"
        return TrackAnswer(**summary, **estimate.model_dump())


def _summary(record: store.SequenceRecord) -> dict[str, Any]:
    sequence = SequenceSummary.of(record)
    links = {"self": f"/v1/tracks/{record.id}", "sequence": sequence.links["self"]}
    return {"id": record.id, "sequence": sequence, "links": links}


def _with_null(values: Floats) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]
