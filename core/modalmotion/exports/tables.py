"""Tables of signatures, as CSV, data frames and arrays with labels."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.clinical.ventricle import VentricleReadouts
from modalmotion.clinical.volume_curve import Fraction
from modalmotion.representation import Array, csv_text, shown
from modalmotion.signature import making, mode_names

if TYPE_CHECKING:
    import pandas
    import xarray

# Of the columns of a value and its interval.
_ENDS: Final = ("", "_low", "_high")


@shown("names", "n_rows")
@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length, by name.

    Parameters
    ----------
    columns : dict of str to array
        Numbers, or texts. A missing number is NaN.
    """

    columns: dict[str, Array]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in order."""
        return tuple(self.columns)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def to_csv(self) -> str:
        """Write the table as CSV (RFC 4180); a missing number is empty.

        Numbers have enough digits to read back the same bits.
        """
        lists = [[_cell(value) for value in column.tolist()] for column in self.columns.values()]
        return csv_text([self.names, *zip(*lists, strict=True)], "\r\n")


def amplitude_table(signature: making.ModalSignature) -> Table:
    """List every amplitude of a signature: a row for each frame, mode and direction.

    Parameters
    ----------
    signature : ModalSignature

    Returns
    -------
    Table
        frame, time_s (NaN if unknown), mode (its rank), label, direction, amplitude, deviation
        (its standard deviation, NaN if unknown), unit.
    """
    frames, modes, n = signature.amplitudes.shape
    directions = mode_names.direction_names(signature)
    times = np.full(frames, np.nan) if signature.times is None else signature.times
    frame, mode, direction = (grid.ravel() for grid in np.indices((frames, modes, n)))
    labels = np.array([str(label) for label in signature.modes.labels])
    sds = signature.amplitude_deviations
    return Table(
        {
            "frame": frame,
            "time_s": times[frame],
            "mode": mode,
            "label": labels[mode],
            "direction": np.array(directions)[direction],
            "amplitude": signature.amplitudes.ravel(),
            "deviation": np.full(frame.shape, np.nan) if sds is None else sds.ravel(),
            "unit": np.full(frame.shape, signature.unit or ""),
        }
    )


def frame_table(
    signature: making.ModalSignature,
    readouts: ClinicalReadouts | None = None,
    ventricle: VentricleReadouts | None = None,
) -> Table:
    """List each frame: motion, error, volume, segments, strain.

    Parameters
    ----------
    signature : ModalSignature
    readouts : ClinicalReadouts, optional
        Adds volume and its bound, in the unit named in the columns.
    ventricle : VentricleReadouts, optional
        Adds inward motion of each segment, and strain with its standard deviation, percent.
    """
    frames = np.arange(signature.n_frames)
    times = np.full(len(frames), np.nan) if signature.times is None else signature.times
    columns: dict[str, Array] = {
        "frame": frames,
        "time_s": times,
        "motion_rms": signature.motion_rms,
        "rms_error": signature.rms_errors,
        "p95_error": signature.p95_errors,
        "max_error": signature.max_errors,
        "unit": np.full(len(frames), signature.unit or ""),
    }
    if readouts is not None:
        unit = "ml" if readouts.unit is not None else "cubed_units"
        factor = readouts.shown_in
        columns[f"volume_{unit}"] = readouts.curve.volumes * factor
        columns[f"volume_bound_{unit}"] = readouts.curve.reach * factor
        columns[f"mesh_volume_{unit}"] = readouts.mesh_curve.volumes * factor
    if ventricle is not None and ventricle.regions is not None:
        regions = ventricle.regions
        for name, share in zip(regions.names, regions.shares.T, strict=True):
            columns[f"inward_{name.replace(' ', '_')}_percent"] = share
    if ventricle is not None and ventricle.strain is not None:
        strain = ventricle.strain
        for name, curve, sd in zip(strain.names, strain.curves.T, strain.deviations.T, strict=True):
            columns[f"{name.lower().replace(' ', '_')}_percent"] = curve
            columns[f"{name.lower().replace(' ', '_')}_deviation"] = sd
    return Table(columns)


@dataclass(frozen=True)
class Recording:
    """A recording of a cohort with its results.

    Parameters
    ----------
    name : str
        Of its file, or its id.
    signature : ModalSignature
    readouts : ClinicalReadouts or None
        None for a surface that encloses nothing.
    subject, label : str or None
    """

    name: str
    signature: making.ModalSignature
    readouts: ClinicalReadouts | None = None
    subject: str | None = None
    label: str | None = None


def cohort_table(recordings: Iterable[Recording]) -> Table:
    """List a cohort: a row for each recording.

    Parameters
    ----------
    recordings : iterable of Recording
        Iterated once.

    Returns
    -------
    Table
        recording, sequence_id, subject, label, surface, frames, modes, duration_s, unit; motion and
        errors, in that unit; volumes, ml (NaN if the unit is unknown); the ejection fraction or
        the volume change with its interval, percent; and for each mode and direction the RMS of its
        amplitude over the frames. NaN if a recording has none.
    """
    rows = [_recording_row(one) for one in recordings]
    names = list(dict.fromkeys(name for row in rows for name in row))
    # Amplitudes are the last columns, whichever recording has more of them.
    names.sort(key=lambda name: name.startswith("rms "))
    texts = {name for row in rows for name, value in row.items() if isinstance(value, str)}
    return Table(
        {
            name: np.array([row.get(name, "" if name in texts else np.nan) for row in rows])
            for name in names
        }
    )


def _recording_row(one: Recording) -> dict[str, Any]:
    signature = one.signature
    times = signature.times
    row: dict[str, Any] = {
        "recording": one.name,
        "sequence_id": signature.sequence_id,
        "subject": one.subject or "",
        "label": one.label or "",
        "surface": signature.surface,
        "frames": signature.n_frames,
        "modes": len(signature.modes),
        "duration_s": np.nan if times is None else float(times[-1] - times[0]),
        "unit": signature.unit or "",
        "motion_rms": float(np.sqrt(np.mean(np.square(signature.motion_rms)))),
        "rms_error": signature.rms_error,
        "weighted_rms_error": signature.weighted_rms_error,
        "max_error": signature.max_error,
        "end_diastolic_volume_ml": np.nan,
        "end_systolic_volume_ml": np.nan,
        **dict.fromkeys(
            (f"{name.value}{end}_percent" for name in Fraction for end in _ENDS), np.nan
        ),
    }
    if one.readouts is not None:
        fraction = one.readouts.stated.fraction
        for name, figure in one.readouts.stated.figures(one.readouts.shown_in).items():
            if name == fraction:
                row.update(zip((f"{name}{end}_percent" for end in _ENDS), figure, strict=True))
            elif f"{name}_ml" in row and one.readouts.unit is not None:
                row[f"{name}_ml"] = figure[0]
    rms = np.sqrt(np.mean(np.square(signature.amplitudes), axis=0))
    for label, values in zip(signature.modes.labels, rms, strict=True):
        for direction, value in zip(mode_names.direction_names(signature), values, strict=True):
            row[f"rms {label} {direction}"] = float(value)
    return row


def _cell(value: Any) -> Any:
    return "" if isinstance(value, float) and value != value else value


def to_dataframe(result: making.ModalSignature | Table) -> pandas.DataFrame:
    """Return a result as a long pandas data frame.

    Parameters
    ----------
    result : ModalSignature or Table
        For a signature, a row for each frame, mode and direction, as `amplitude_table`.

    Raises
    ------
    MissingExtraError
        If pandas is not installed.
    """
    with errors.needs_extra("tables"):
        import pandas

    table = result if isinstance(result, Table) else amplitude_table(result)
    return pandas.DataFrame(table.columns)


def to_xarray(
    signature: making.ModalSignature, readouts: ClinicalReadouts | None = None
) -> xarray.Dataset:
    """Return a signature as an xarray dataset with named axes and units.

    Parameters
    ----------
    signature : ModalSignature
    readouts : ClinicalReadouts, optional
        Adds the volume.

    Returns
    -------
    xarray.Dataset
        amplitude (frame, mode, direction), its deviation if known, its spectrum and
        frequencies by mode, errors and volume by frame; coordinates label, wavenumber, time_s;
        attributes unit, ids, notes. It can be written to netCDF and read back without loss.

    Raises
    ------
    MissingExtraError
        If xarray is not installed.
    """
    with errors.needs_extra("tables"):
        import xarray

    unit, sds = signature.unit or "length units", signature.amplitude_deviations
    lengths, of_all = {"units": unit}, ("frame", "mode", "direction")
    variables: dict[str, Any] = {
        "amplitude": (of_all, signature.amplitudes, lengths),
        "spectrum": ("mode", signature.deformation_spectrum, lengths),
        "angular_frequency": ("mode", signature.angular_frequencies, {"units": "rad/s"}),
        "rotation": (("frame", "row", "column"), signature.rotations.matrices),
        "translation": (("frame", "axis_name"), signature.translations, lengths),
        **({} if sds is None else {"deviation": (of_all, sds, lengths)}),
    }
    for name, column in frame_table(signature, readouts).columns.items():
        if name not in ("frame", "time_s", "unit"):
            units = readouts.volume_unit if readouts is not None and "volume" in name else unit
            variables[name] = ("frame", column, {"units": units})
    coordinates: dict[str, Any] = {
        "frame": np.arange(signature.n_frames),
        "mode": np.arange(len(signature.modes)),
        "label": ("mode", np.array([str(label) for label in signature.modes.labels])),
        "wavenumber": (("mode", "axis"), signature.modes.wavenumbers),
        "direction": np.array(mode_names.direction_names(signature)),
        "axis_name": np.array(["x", "y", "z"]),
    }
    if signature.times is not None:
        coordinates["time_s"] = ("frame", signature.times, {"units": "s"})
    attributes = {
        "unit": unit,
        "surface": signature.surface,
        "kind": signature.kind.value,
        "sequence_id": signature.sequence_id,
        "template_id": signature.template_id,
        "rms_error": signature.rms_error,
        "facts": json.dumps(mesh.facts_as_json(signature.facts)),
        "notes": "\n".join(map(str, signature.notes)),
        "provenance": json.dumps(signature.provenance),
    }
    return xarray.Dataset(variables, coordinates, attributes)
