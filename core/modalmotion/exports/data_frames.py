"""Results as pandas data frames and xarray datasets. Needs the extra ``tables``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.errors import needs_extra
from modalmotion.exports.table import Table, amplitude_table, direction_names, frame_table
from modalmotion.facts import facts_as_json
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    import pandas
    import xarray


def to_dataframe(result: ModalSignature | Table) -> pandas.DataFrame:
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
    with needs_extra("tables"):
        import pandas

    table = result if isinstance(result, Table) else amplitude_table(result)
    return pandas.DataFrame(table.columns)


def to_xarray(
    signature: ModalSignature, readouts: ClinicalReadouts | None = None
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
    with needs_extra("tables"):
        import xarray

    unit = signature.unit or "length units"
    lengths = {"units": unit}
    variables: dict[str, Any] = {
        "amplitude": (("frame", "mode", "direction"), signature.amplitudes, lengths),
        "spectrum": ("mode", signature.deformation_spectrum, lengths),
        "angular_frequency": ("mode", signature.angular_frequencies, {"units": "rad/s"}),
        "rotation": (("frame", "row", "column"), signature.rotations.matrices),
        "translation": (("frame", "axis_name"), signature.translations, lengths),
    }
    if signature.amplitude_deviations is not None:
        sds = signature.amplitude_deviations
        variables["deviation"] = (("frame", "mode", "direction"), sds, lengths)
    for name, column in frame_table(signature, readouts).columns.items():
        if name not in ("frame", "time_s", "unit"):
            volume = readouts.volume_unit if readouts is not None else ""
            units = volume if "volume" in name else unit
            variables[name] = ("frame", column, {"units": units})
    coordinates: dict[str, Any] = {
        "frame": np.arange(signature.n_frames),
        "mode": np.arange(len(signature.modes)),
        "label": ("mode", np.array([str(label) for label in signature.modes.labels])),
        "wavenumber": (("mode", "axis"), signature.modes.wavenumbers),
        "direction": np.array(direction_names(signature)),
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
        "facts": json.dumps(facts_as_json(signature.facts)),
        "notes": "\n".join(signature.notes),
        "provenance": json.dumps(signature.provenance),
    }
    return xarray.Dataset(variables, coordinates, attributes)
