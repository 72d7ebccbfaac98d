"""Tracks: what is asked of one, and what was found."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from modalmotion.errors import ParameterError
from modalmotion.facts import NAMES, NO_FACTS, Facts, facts_from_texts
from modalmotion.store import SequenceRecord
from modalmotion.tracking import Track
from modalmotion.tracking.landmarks import landmarks_from_json, landmarks_of
from modalmotion.tracking.making import MOST_MODES
from modalmotion.tracking.parameters import USUAL_MODES, TrackParameters
from modalmotion.tracking.reading import USUAL_CONTOURS
from modalmotion.tracking.result import Papillary
from modalmotion_service.schemas.facts import FactsQuery
from modalmotion_service.schemas.fields import POINT, SequenceId, parse_times
from modalmotion_service.schemas.sequences import SequenceSummary
from modalmotion_service.schemas.signatures import Label


class TrackQuery(FactsQuery):
    """How to track, and statements about the recording, which override its files'."""

    model_config = ConfigDict(extra="forbid")

    landmarks: str | None = Field(
        None,
        max_length=50_000,
        description='As JSON, by name: {"apex": [x, y, z], "base": [[x, y, z], null, ...]}, a '
        "place in the reference frame, or one for each frame.",
    )
    apex: str | None = POINT
    base: str | None = POINT
    start: SequenceId | None = Field(
        None,
        description="A stored sequence: the surface of its first frame is started from, and the "
        "result has its vertices.",
    )
    topology: str | None = Field(
        None,
        max_length=80,
        description="Of a start without a surface: cup, sphere, cylinder, plane, open curve or "
        "closed curve. A cup where apex and base are stated, else a sphere.",
    )
    modes: int = Field(
        USUAL_MODES, ge=2, le=MOST_MODES, description="Three amplitudes a frame each."
    )
    time: Literal["cycle", "open"] = Field(
        "cycle", description="Whether the frames are one period, or part of a motion."
    )
    reference: str = Field(
        "0",
        pattern="^([0-9]{1,9}|none)$",
        description="Frame that it starts from, whose surface a start is; none where it is the "
        "surface of none.",
    )
    contours: str = Field(
        ",".join(USUAL_CONTOURS),
        min_length=1,
        max_length=1000,
        description="Of typed contours: parts of the names to read, such as LV_ENDOCARDIAL.",
    )
    images: SequenceId | None = Field(
        None, description="Images that were sent before, in place of a body; see POST /v1/images."
    )
    keep: bool = Field(
        False, description="Keep the images; they are deleted once they are tracked otherwise."
    )
    papillary: Papillary = Field(
        "pool",
        description="Of images: whether papillary muscles count as cavity (pool) or not (wall).",
    )
    labels: str | None = Field(
        None,
        max_length=300,
        description="Of label maps: values of the cavity, such as 3 or 1,3; apex and base are "
        "proposed from them.",
    )
    wall: str | None = Field(
        None, max_length=300, description="Of label maps: values of the wall around it."
    )
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    times: str | None = Field(None, max_length=50_000, description="In s, such as 0,0.04,0.08.")
    frame_interval: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="In s, in place of times."
    )
    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")

    def facts(self) -> Facts:
        """Translate to the library's facts; landmarks are the tracking's own."""
        own = [name for name in NAMES if name != "landmarks"]
        return facts_from_texts({name: getattr(self, name) for name in own})

    def parameters(self, form: Facts = NO_FACTS) -> TrackParameters:
        """Translate to the library's parameters; the query overrides facts of a form.

        Raises
        ------
        ParameterError
            If one cannot be read, or two contradict each other.
        """
        if self.keep and self.images is None:
            raise ParameterError(
                "Images are to be kept, and none are named.",
                remedy="Send them to POST /v1/images first, and name them: images=ID&keep=true.",
            )
        if self.times is not None and self.frame_interval is not None:
            raise ParameterError(
                "Both times and an interval between frames are stated.", remedy="Keep one."
            )
        landmarks: dict[str, NDArray[np.float64]] = landmarks_of(form)
        if self.landmarks is not None:
            landmarks |= landmarks_from_json(self.landmarks)
        for name in ("apex", "base"):
            if (text := getattr(self, name)) is not None:
                landmarks[name] = np.array(parse_times(text))
        return TrackParameters(
            topology=self.topology,
            modes=self.modes,
            time=self.time,
            reference=None if self.reference == "none" else int(self.reference),
            contours=tuple(part for part in self.contours.split(",") if part),
            landmarks=landmarks,
            papillary=self.papillary,
            labels=_labels("labels", self.labels),
            wall=_labels("wall", self.wall),
            unit=self.unit,
            times=self.frame_interval if self.times is None else tuple(parse_times(self.times)),
            facts=self.facts().over(replace(form, landmarks={})),
        )


class TrackedReportQuery(TrackQuery):
    """How to track, and which model names the class of what is found."""

    model: str | None = Field(
        None,
        max_length=80,
        description="A name, or name@version; of the shipped ones the one is asked that reads what "
        "the points follow. None by default.",
    )


class TrackViewQuery(BaseModel):
    """What a picture of a track shows."""

    model_config = ConfigDict(extra="forbid")

    picture: Literal["deviations", "data", "determined", "overlay"] = Field(
        "deviations",
        description="Stated error on the surface, data over the surface by frame, the share of "
        "each mode that the data have set, or contours over the images, where these were kept.",
    )
    frame: int | None = Field(
        None, ge=0, description="Of the stated error; that of the smallest volume by default."
    )


class ImagesEstimate(BaseModel):
    """What was found of images that were tracked."""

    papillary: Papillary = Field(description="Convention of the volumes.")
    papillary_volume: float = Field(description="Within the surface, like its outside; mm^3.")
    ejection_fractions: dict[str, float] = Field(description="Under both conventions, percent.")
    inside: float = Field(description="Brightness within the surface in the reference frame.")
    outside: float
    spread: float = Field(description="Standard deviation of brightness on one side.")
    shifts: list[list[float]] = Field(
        description="By which each slice shows everything aside, mm; none of volumes."
    )
    shift_deviation: float = Field(description="Of a shift along one axis, mm.")
    found: list[float] = Field(description="Share of profiles with an edge in each frame.")

    @staticmethod
    def of(track: Track) -> ImagesEstimate | None:
        """Write out what a track says of its images; None of one without."""
        own = track.images
        if own is None:
            return None
        return ImagesEstimate(
            papillary=own.papillary,
            papillary_volume=own.papillary_volume,
            ejection_fractions=track.ejection_fractions,
            inside=own.inside,
            outside=own.outside,
            spread=own.spread,
            shifts=[list(row) for row in own.shifts],
            shift_deviation=own.shift_sd,
            found=list(own.found),
        )


class TrackEstimate(BaseModel):
    """What was found, and how well; lengths in the unit of the sequence."""

    modes: list[Label]
    reference: int | None = Field(description="Frame whose surface the start is; null for none.")
    noise: float = Field(description="Standard deviation of a point.")
    residual_rms: list[float | None] = Field(
        description="Of each frame, of the points that counted; null without any."
    )
    residual_p95: list[float | None]
    inliers: list[float] = Field(description="Share of the points of each frame that counted.")
    coverage: list[float] = Field(description="Share of the surface that points lie at.")
    unseen: list[int] = Field(description="Frames without points, which are interpolated.")
    deviation_across: list[float] = Field(
        description="Of each frame: standard deviation of a vertex across the surface, RMS."
    )
    deviation_along: list[float] = Field(
        description="The same in each direction along it, where the prior speaks."
    )
    truncations: list[float] = Field(description="RMS of what the modes leave in each frame.")
    determined: list[list[float]] = Field(
        description="Share of each mode that the data have set, across the surface and along it; "
        "below 0.5 it is the prior's."
    )
    gap: float | None = Field(
        description="Distance of the shapes that both ways round the cycle end at; null of an "
        "open recording."
    )
    volumes: list[float] | None = Field(description="Cubed unit; null of what encloses none.")
    volume_deviations: list[float] | None
    ejection_fraction: float | None = Field(
        description="Share of the largest volume that the smallest lacks, percent."
    )
    ejection_fraction_bound: float | None = Field(
        description="Two standard deviations, percentage points."
    )
    times: list[float] | None = Field(description="In s.")
    images: ImagesEstimate | None = Field(description="Null where points were tracked.")
    parameters: dict[str, Any] = Field(description="As they were used.")
    notes: list[str]

    @staticmethod
    def of(track: Track) -> TrackEstimate:
        """Write a track out, without its surfaces and amplitudes."""
        rms = np.sqrt(np.mean(track.deviations**2, axis=1))
        return TrackEstimate(
            modes=[Label.of(label) for label in track.modes.labels],
            reference=track.reference,
            noise=track.noise.sd,
            residual_rms=_with_null(track.residuals[:, 0]),
            residual_p95=_with_null(track.residuals[:, 1]),
            inliers=track.inliers.tolist(),
            coverage=track.coverage.tolist(),
            unseen=list(track.unseen),
            deviation_across=rms[:, 0].tolist(),
            deviation_along=rms[:, 1].tolist(),
            truncations=track.truncations.tolist(),
            determined=track.determined.tolist(),
            gap=track.gap,
            volumes=_plain(track.volumes),
            volume_deviations=_plain(track.volume_deviations),
            ejection_fraction=track.ejection_fraction,
            ejection_fraction_bound=track.ejection_fraction_bound,
            times=_plain(track.sequence.times),
            images=ImagesEstimate.of(track),
            parameters=dict(track.provenance),
            notes=list(track.notes),
        )


class TrackSummary(BaseModel):
    """A track, and the sequence that it made, which has the same id."""

    id: str = Field(description="That of the sequence.")
    sequence: SequenceSummary
    links: dict[str, str]

    @staticmethod
    def of_record(record: SequenceRecord) -> TrackSummary:
        """Summarise the record of a tracked sequence."""
        return TrackSummary(**_summary(record))


class TrackAnswer(TrackEstimate, TrackSummary):
    """A track: its sequence, and what was found besides."""

    @staticmethod
    def joined(
        estimate: TrackEstimate, record: SequenceRecord, images_id: str | None
    ) -> TrackAnswer:
        """Add to what was found the record of its sequence, and the images that were kept."""
        summary = _summary(record)
        if images_id is not None:
            summary["links"]["images"] = f"/v1/images/{images_id}"
        return TrackAnswer(**summary, **estimate.model_dump())


class TrackPageAnswer(BaseModel):
    """A page of the list of tracks."""

    tracks: list[TrackSummary]
    cursor: str | None = Field(description="For the next page; null on the last.")


def _summary(record: SequenceRecord) -> dict[str, Any]:
    sequence = SequenceSummary.of(record)
    links = {"self": f"/v1/tracks/{record.id}", "sequence": sequence.links["self"]}
    return {"id": record.id, "sequence": sequence, "links": links}


def _with_null(values: NDArray[np.float64]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _plain(values: NDArray[np.float64] | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _labels(name: str, text: str | None) -> tuple[int, ...]:
    try:
        return () if text is None else tuple(int(word) for word in text.split(","))
    except ValueError:
        raise ParameterError(
            f"The values of {name} are {text!r:.40}.", remedy="Write whole numbers, such as 1,3."
        ) from None
