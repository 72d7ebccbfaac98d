"""Clinical read-outs."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion.clinical import ClinicalReadouts, Fraction, VolumeCurve
from modalmotion.clinical.plain import ventricle_json
from modalmotion.clinical.ventricle import VentricleReadouts
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion_service.schemas.from_core import read_from


class FigureAnswer(BaseModel):
    """One number, and the interval in which the surface's own is."""

    value: float
    low: float
    high: float

    @staticmethod
    def of(value: float, interval: tuple[float, float], factor: float = 1.0) -> FigureAnswer:
        """Write a figure out in another unit."""
        low, high = (end * factor for end in interval)
        return FigureAnswer(value=value * factor, low=low, high=high)


class VolumeAnswer(BaseModel):
    """Volume over time, and its read-outs."""

    volumes: list[float] = Field(description="Of each frame, in `volume_unit`.")
    bounds: list[float] = Field(
        description="The surface's own volume is at most this far from it, in `volume_unit`."
    )
    end_diastole: int = Field(description="Frame of the largest volume.")
    end_systole: int = Field(description="Frame of the smallest volume.")
    end_diastolic_volume: FigureAnswer
    end_systolic_volume: FigureAnswer
    stroke_volume: FigureAnswer
    ejection_fraction: FigureAnswer | None = Field(
        description="Stroke volume over end-diastolic volume, percent, where a cavity is stated or "
        "the surface is a cup. Null elsewhere, of one frame, and where a volume is not positive."
    )
    volume_change: FigureAnswer | None = Field(
        description="The same share where nothing says that the surface is that of a cavity."
    )

    @staticmethod
    def of(curve: VolumeCurve, factor: float) -> VolumeAnswer:
        """Write a curve out in another unit."""
        share = None
        if curve.share is not None and curve.share_range is not None:
            share = FigureAnswer.of(curve.share, curve.share_range)
        is_ejected = curve.fraction == Fraction.EJECTION_FRACTION
        return read_from(
            VolumeAnswer,
            curve,
            volumes=(curve.volumes * factor).tolist(),
            bounds=(curve.bounds * factor).tolist(),
            end_diastolic_volume=FigureAnswer.of(
                curve.end_diastolic_volume, curve.end_diastolic_range, factor
            ),
            end_systolic_volume=FigureAnswer.of(
                curve.end_systolic_volume, curve.end_systolic_range, factor
            ),
            stroke_volume=FigureAnswer.of(curve.stroke_volume, curve.stroke_range, factor),
            ejection_fraction=share if is_ejected else None,
            volume_change=None if is_ejected else share,
        )


class RatesAnswer(BaseModel):
    """How fast the cavity empties and fills; volumes in `volume_unit`."""

    peak_ejection_rate: float = Field(description="Volume per s, positive.")
    peak_filling_rate: float = Field(description="Volume per s.")
    ejection_bound: float = Field(description="Largest error: of its volumes, and between frames.")
    filling_bound: float = Field(description="Largest error: of its volumes, and between frames.")
    ejection_frame: int
    filling_frame: int
    heart_rate: float | None = Field(description="Beats per minute; null without a stated period.")
    cardiac_output: float | None = Field(description="Volume per minute.")
    output_range: tuple[float, float] | None = Field(description="Interval that holds it.")


class SegmentsAnswer(BaseModel):
    """Inward motion of the wall over the radius at end diastole (Cerqueira 2002)."""

    names: list[str] = Field(description="The 17 segments, or the four rings.")
    percent: list[list[float | None]] = Field(description="By frame, then by segment.")
    end_diastole: int
    reason: str = Field(description="Why there are rings only; empty if there are segments.")


class StrainFigureAnswer(BaseModel):
    """A strain since end diastole, percent; negative is shorter."""

    name: str = Field(description="GLS, GCS, GAS, or GCS at one level.")
    definition: str = Field(description="What it is the relative change of.")
    end_systolic: FigureAnswer = Field(description="At end systole, with its 95 % interval.")
    peak: FigureAnswer = Field(description="Where it is most negative.")
    curve: list[float] = Field(description="By frame.")
    deviations: list[float] = Field(description="Standard deviation by frame, points.")


class SegmentStrainAnswer(BaseModel):
    """Strain of the segments, percent."""

    names: list[str] = Field(description="The 17 segments, or the four rings.")
    directions: list[str]
    percent: list[list[list[float | None]]] = Field(description="By frame, segment, direction.")
    end_systolic_deviations: list[list[float | None]] = Field(
        description="Standard deviation at end systole by segment and direction, points."
    )
    reason: str = Field(description="Why there are rings only; empty if there are segments.")


class StrainAnswer(BaseModel):
    """Strain of the wall as lengths and areas of its smooth surface (Voigt 2015)."""

    figures: list[StrainFigureAnswer]
    segments: SegmentStrainAnswer
    dyssynchrony: FigureAnswer | None = Field(
        description="Systolic dyssynchrony index, percent of the cycle; null of too few frames."
    )
    end_diastole: int
    end_systole: int
    found_by: str = Field(description="How these frames were found.")
    layer: str = Field(description="Surface of the wall that was measured.")
    source: str = Field(description="What the surface came from.")
    notes: list[str]


class TorsionAnswer(BaseModel):
    """Turning and shear of a wall of material points since end diastole, degrees, by frame."""

    twist: list[float] = Field(
        description="Rotation of the apical less that of the basal third, right-handed about the "
        "axis from apex to base."
    )
    twist_deviations: list[float] = Field(description="Standard deviations.")
    shear: list[float] = Field(
        description="Mean change of the angle between lines along and around the wall."
    )
    shear_deviations: list[float] = Field(description="Standard deviations.")
    end_diastole: int
    end_systole: int


class PerModeAnswer(BaseModel):
    """What one length unit of each amplitude does to the read-outs at end systole."""

    names: list[str] = Field(description="Of the read-outs; volumes at their own moment.")
    units: list[str]
    modes: list[str]
    values: list[list[list[float]]] = Field(description="By read-out, mode and direction.")


class ReadoutsAnswer(BaseModel):
    """Read-outs from a cavity's volume over time."""

    sequence_id: str
    template_id: str
    amplitudes_per_frame: int
    volume_unit: str = Field(description="ml; cubed length units where the unit is unknown.")
    times: list[float] | None = Field(description="s")
    n_openings: int = Field(description="Each closed by a fan to the mean of its vertices.")
    from_signature: VolumeAnswer = Field(
        description="From the amplitudes and the reference shape; the bounds are what leaving "
        "out all other modes puts on it, not the accuracy of the measurement."
    )
    of_mesh: VolumeAnswer = Field(description="Of the frames as they were sent.")
    rates: RatesAnswer | None = Field(description="Null where times are unknown.")
    segments: SegmentsAnswer | None = Field(description="Null where this is not a ventricle.")
    strain: StrainAnswer | None = Field(
        description="Null of a surface without coordinates along and around it."
    )
    torsion: TorsionAnswer | None = Field(
        description="Null where nothing says that vertices follow the tissue (tracking=material)."
    )
    per_mode: PerModeAnswer | None = Field(description="Null where a volume is not known.")
    notes: list[str]
    intended_use: str = INTENDED_USE

    @staticmethod
    def of(readouts: ClinicalReadouts, ventricle: VentricleReadouts) -> ReadoutsAnswer:
        """Write read-outs out."""
        factor = readouts.shown_in
        return read_from(
            ReadoutsAnswer,
            readouts,
            amplitudes_per_frame=readouts.n_amplitudes,
            from_signature=VolumeAnswer.of(readouts.curve, factor),
            of_mesh=VolumeAnswer.of(readouts.mesh_curve, factor),
            notes=[*readouts.notes, *ventricle.reasons],
            **ventricle_json(ventricle),
        )
