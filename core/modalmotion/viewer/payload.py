"""What the viewer is sent first: the reference, natural coordinates, amplitudes, and words.

Shapes in closed form are not sent: the page evaluates them once at (s, theta). Positions are
from the reference's centroid, since single precision loses digits far from the origin.
"""

from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion import clinical, errors, notes
from modalmotion.classification.answer import Classification
from modalmotion.clinical import segments, volume_curve
from modalmotion.clinical.readouts import ClinicalReadouts, Rates
from modalmotion.clinical.strain import DEFINITIONS, DYSSYNCHRONY, Strain
from modalmotion.clinical.ventricle import Sensitivities, ventricle_readouts
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh import alignment, spring_modes
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE
from modalmotion.numeric.scales import power_of_two
from modalmotion.pictures.views import upright
from modalmotion.representation import Floats
from modalmotion.signature import mode_names, normal_displacements, reconstruction
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.template import Template, body_frame
from modalmotion.template.template import nearest_in_use, shapes_of
from modalmotion.viewer.container import write_container

# Below and above single precision has too few powers of ten; lengths are then sent in another.
_SMALLEST: Final = 1e-9
_LARGEST: Final = 1e9

# Stands for a segment without vertices: JSON and single precision have no NaN to send.
_UNKNOWN: Final = -1e9

# A first frame this near after the last, in usual steps, closes a cycle; nearer repeats it.
_CLOSES: Final = 2.0
_REPEATS: Final = 0.3

# Of the largest effect of any mode on a read-out: what is less is rounding.
_NO_EFFECT: Final = 1e-6

# Numbers of the shapes of a mesh without natural coordinates that a page is sent at most.
MOST_SHAPES: Final = 20_000_000


def view_payload(
    signature: ModalSignature,
    sequence: MeshSequence,
    *,
    template: Template | None = None,
    classification: Classification | None = None,
    title: str = "",
    is_tracked: bool = False,
) -> bytes:
    """Write what a page needs to show a signature beside its sequence.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    classification : Classification, optional
        An answer about it; its explanation becomes buttons.
    title : str
        Such as a file's name.
    is_tracked : bool
        Whether the service that shows it has a track of it, to be shown beside it.

    Returns
    -------
    bytes
        As of `write_container`. The frames as sent follow in `frames_payload`.

    Raises
    ------
    ParameterError
        If the sequence is not the one the signature was made from.
    LimitError
        If the surface has no natural coordinates, and too many shapes to be sent.
    """
    used, start, centre, directions = _placed(signature, sequence, template)
    along_normal = signature.kind == SignatureKind.NORMAL_DISPLACEMENT
    arrays: dict[str, NDArray[Any]] = {}
    if not along_normal and signature.parameters.components != body_frame.Components.CARTESIAN:
        directions = body_frame.local_frames(used)
    scale = length_scale(sequence, centre)
    arrays["rest"] = _single((start - centre) / scale)
    arrays["faces"] = used.faces.astype(np.uint16 if used.n_vertices <= 2**16 else np.uint32)
    if directions is not None:
        arrays["directions"] = _single(directions)
    if signature.topology is None:
        arrays["shapes"] = _mesh_shapes(signature, used)
    else:
        coordinates = used.coordinates.copy()
        if len(used.isolated):
            nearest = nearest_in_use(used.vertices, used.isolated)
            coordinates[used.isolated] = coordinates[nearest]
        arrays["coordinates"] = _single(coordinates)
    arrays["amplitudes"] = _single(signature.amplitudes / scale)
    arrays["quaternions"] = _single(
        scipy.spatial.transform.Rotation.from_matrix(signature.rotations.matrices).as_quat()
    )
    arrays["translations"] = _single(signature.translations / scale)
    for name in ("motion_rms", "rms_errors", "max_errors"):
        arrays[name] = _single(getattr(signature, name) / scale)
    if signature.times is not None:
        arrays["times"] = signature.times - signature.times[0]
    # A signature that a store keeps has no facts of its own.
    period = sequence.facts.period or signature.facts.period
    header = {
        "title": title,
        "is_tracked": is_tracked,
        "intended_use": INTENDED_USE,
        "sequence_id": signature.sequence_id,
        "surface": signature.surface,
        "ends": _ends(signature),
        "unit": _unit(signature.unit, scale),
        "centre": centre.tolist(),
        "length": scale,
        "n_frames": signature.n_frames,
        "n_vertices": sequence.n_vertices,
        "n_amplitudes": signature.n_amplitudes,
        "holds_drift": not along_normal,
        "reference": signature.parameters.reference,
        "cycle": _cycle(signature, period),
        "period": period,
        "error": {"rms": signature.rms_error / scale, "max": signature.max_error / scale},
        "compression": signature.compression,
        "view": np.round(upright(used), 6).tolist(),
        "waves": _waves(signature, used),
        "notes": notes.notes_as_json(signature.notes),
        **_volume(signature, sequence, template, arrays),
        **_classification(classification),
    }
    if signature.topology is not None:
        header["wavenumbers"] = signature.modes.wavenumbers.tolist()
        header["sines"] = signature.modes.is_sine.astype(int).tolist()
    return write_container(header, arrays)


def frames_payload(
    sequence: MeshSequence,
    signature: ModalSignature,
    first: int = 0,
    stop: int | None = None,
    *,
    template: Template | None = None,
) -> bytes:
    """Write frames as they were sent, in 65,536 steps of their box along each axis.

    Parameters
    ----------
    sequence : MeshSequence
    signature : ModalSignature
        Made from it: positions are from the same centroid, in the same unit.
    first, stop : int
        Frames; all by default.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    """
    _, _, centre, _ = _placed(signature, sequence, template)
    scale = length_scale(sequence, centre)
    x = (sequence.vertices[first:stop].astype(np.float64) - centre) / scale
    low = x.min(axis=(0, 1)) if x.size else np.zeros(3)
    step = (x.max(axis=(0, 1)) - low) / 65535.0 if x.size else np.ones(3)
    steps = np.where(step > 0, step, 1.0)
    frames = np.rint((x - low) / steps).astype(np.uint16)
    header = {"first": first, "low": low.tolist(), "step": step.tolist()}
    return write_container(header, {"frames": frames})


def _placed(
    signature: ModalSignature, sequence: MeshSequence, template: Template | None
) -> tuple[Template, Floats, Floats, Floats | None]:
    """Give the template, the surface at rest, its centroid, and the normals, if they are used."""
    used = reconstruction.fitted_on(signature, sequence, template)
    start = alignment.reference_positions(sequence, signature.parameters.reference)
    if signature.kind != SignatureKind.NORMAL_DISPLACEMENT:
        return used, start, used.weights @ start, None
    directions, centre = normal_displacements.normal_reference(used, start)
    return used, start, centre, directions


def length_scale(sequence: MeshSequence, centre: Floats) -> float:
    """Length that is sent as 1: one unit, but for extremes a power of two."""
    return single_scale(float(np.abs(sequence.vertices - centre).max(initial=0.0)))


def single_scale(size: float) -> float:
    """Length that is sent as 1, so that others up to a size are in single precision's range."""
    return 1.0 if size == 0.0 or _SMALLEST < size < _LARGEST else power_of_two(size)


def _single(values: Floats) -> NDArray[np.float32]:
    return values.astype(np.float32)


def _ends(signature: ModalSignature) -> list[list[str]] | None:
    topology = signature.topology
    return None if topology is None else [[e.value for e in ends] for ends in topology.ends]


def _unit(unit: str | None, scale: float) -> str:
    name = unit or "length units"
    return name if scale == 1.0 else f"{scale:.3g} {name}"


def _mesh_shapes(signature: ModalSignature, template: Template) -> NDArray[np.float16]:
    n = len(signature.modes) * template.n_vertices
    if n > MOST_SHAPES:
        raise errors.LimitError(
            f"{len(signature.modes)} shapes of {template.n_vertices} vertices are {n} numbers; a "
            f"page is sent at most {MOST_SHAPES}.",
            remedy="Ask for fewer modes, or state a topology: closed forms need not be sent.",
            limit="view_shapes",
            details={"value": n, "most": MOST_SHAPES},
        )
    return shapes_of(signature.modes, template).T.astype(np.float16)


def _waves(signature: ModalSignature, template: Template) -> list[dict[str, Any]]:
    """Modes by waves, a cosine with its sine, each with its words."""
    spectrum, labels = signature.deformation_spectrum, signature.modes.labels
    entries = []
    for modes in _modes_of_waves(signature):
        label = labels[modes[0]]
        numbers = ", ".join(map(str, label.wavenumbers))
        entries.append(
            {
                "modes": modes,
                "label": f"({numbers})" if len(modes) == 2 else str(label),
                "name": wave_name(signature, template, modes),
                "tone": mode_names.mode_tone(label) % len(mode_names.COLOURS),
                "dash": list(mode_names.mode_dash(label)),
                "rms": float(f"{np.hypot.reduce(spectrum[modes]):.4g}"),
            }
        )
    return entries


def _modes_of_waves(signature: ModalSignature) -> list[list[int]]:
    """Places of the modes of each wave."""
    pairs = zip(*map(np.ndarray.tolist, spring_modes.wave_pairs(signature.modes)), strict=True)
    waves = [[cosine] if sine < 0 else [cosine, sine] for cosine, sine in pairs]
    seen = {mode for modes in waves for mode in modes}
    return waves + [[mode] for mode in range(len(signature.modes)) if mode not in seen]


def _cycle(signature: ModalSignature, period: float | None) -> str:
    gap, n = signature.closure_gap, signature.n_frames
    if n < 3 or gap > _CLOSES:
        return "open"
    if period is not None and signature.times is not None:
        # A wall at rest does not show whether the last frame repeats the first.
        span = float(signature.times[-1] - signature.times[0])
        return "closes" if period > span + 0.5 * span / (n - 1) else "repeats"
    return "repeats" if gap < _REPEATS else "closes"


def _volume(
    signature: ModalSignature,
    sequence: MeshSequence,
    template: Template | None,
    arrays: dict[str, NDArray[Any]],
) -> dict[str, Any]:
    """Volume, strain and segments, or why there are none."""
    words: dict[str, Any] = {"rates": [], "reasons": [], "effects": None}
    try:
        readouts = clinical.clinical_readouts(signature, sequence, template=template)
    except errors.InputError as error:
        refused = {"refused": error.message, "codes": [error.code]}
        return {**words, **dict.fromkeys(("volume", "strain", "segments"), refused)}
    ventricle = ventricle_readouts(signature, sequence, readouts, template=template)
    reasons = ventricle.reasons
    refused = {
        "refused": " ".join(map(str, reasons)),
        "codes": [str(note.data["error"]) for note in reasons],
    }
    rates, regions, strain = ventricle.rates, ventricle.regions, ventricle.strain
    volume, per_mode = _volume_words(readouts, arrays), ventricle.per_mode
    shares = [volume["share"]] if "share" in volume else []
    names = [one["name"] for one in (*volume["figures"][:2], *shares)]
    return {
        "volume": volume,
        "effects": None if per_mode is None else _effect_words(per_mode, names, signature),
        "rates": [] if rates is None else _rate_words(rates, readouts, sequence),
        "strain": refused if strain is None else _strain_words(strain, sequence, arrays),
        "reasons": notes.notes_as_json(reasons),
        "segments": refused if regions is None else _segment_words(regions, strain, readouts),
    }


def _effect_words(
    per_mode: Sensitivities, names: list[str], signature: ModalSignature
) -> dict[str, Any]:
    """Effect of a unit of each wave on each read-out, in the direction in which it is largest."""
    directions, of_waves = mode_names.direction_names(signature), []
    least = _NO_EFFECT * np.abs(per_mode.values).max(axis=(1, 2))
    for modes in _modes_of_waves(signature):
        # In the order of `directions`, those of the cosine first.
        own = per_mode.values[:, modes].reshape(len(per_mode.names), -1)
        ways = np.abs(own).argmax(axis=1)
        values = own[np.arange(len(own)), ways]
        seen = np.where(np.abs(values) > least, values, 0.0).tolist()
        of_waves.append([[float(f"{x:.3g}") for x in seen], ways.tolist()])
    return {
        "step": f"1 {signature.unit or 'length unit'}",
        "names": [*names, *per_mode.names[len(names) :]],
        "units": list(per_mode.units),
        "directions": [f"{way}{part}" for part in (", cosine", ", sine") for way in directions],
        "waves": of_waves,
    }


def _strain_words(
    strain: Strain, sequence: MeshSequence, arrays: dict[str, NDArray[Any]]
) -> dict[str, Any]:
    n = len(DEFINITIONS)
    arrays["strain"] = _single(strain.curves[:, :n])
    arrays["strain_reach"] = _single(volume_curve.TWO_DEVIATIONS * strain.deviations[:, :n])
    arrays["segment_strain"] = _single(np.nan_to_num(strain.by_segment[:, :, 0], nan=_UNKNOWN))
    figures = [
        {
            "name": name,
            "definition": f"relative change of the {words}, since end diastole, at end systole",
            "unit": "%",
            **strain.end_systolic[name]._asdict(),
            "peak": strain.peak[name]._asdict(),
            "time_to_peak": _time_from(
                sequence, strain.end_diastole, int(strain.curves[:, place].argmin())
            ),
        }
        for place, (name, words) in enumerate(DEFINITIONS.items())
    ]
    if strain.dyssynchrony is not None:
        index = {"name": "SDI", "definition": DYSSYNCHRONY, "unit": "% of the cycle"}
        figures.append({**index, **strain.dyssynchrony._asdict()})
    return {
        "figures": figures,
        "layer": strain.layer,
        "source": strain.source,
        "segments": list(strain.segments),
        "notes": notes.notes_as_json(strain.notes),
    }


def _time_from(sequence: MeshSequence, start: int, end: int) -> float | None:
    """Time from one frame to the next time that another comes, s; None if it is unknown."""
    times = sequence.times
    if times is None or len(times) < 2:
        return None
    span = float(times[-1] - times[0])
    cycle = sequence.facts.period or span * len(times) / (len(times) - 1)
    return float(times[end] - times[start]) % cycle


def _volume_words(readouts: ClinicalReadouts, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    curve, factor = readouts.stated, readouts.shown_in
    other = readouts.curve if readouts.is_tracked else readouts.mesh_curve
    arrays["volumes"] = curve.volumes * factor
    arrays["volume_reach"] = curve.reach * factor
    arrays["other_volumes"] = other.volumes * factor
    is_ejected = curve.fraction == volume_curve.Fraction.EJECTION_FRACTION
    moments = ("end diastole", "end systole") if is_ejected else ("largest", "smallest")
    names = ("EDV", "ESV", "SV") if is_ejected else ("Largest", "Smallest", "Difference")
    largest, smallest = (
        f"volume at {name}, the {size} of all frames" if is_ejected else f"{size} volume"
        for name, size in zip(moments, ("largest", "smallest"), strict=True)
    )
    difference = "the largest volume less the smallest"
    figures, unit = curve.figures(factor), readouts.volume_unit
    share = figures.pop(str(curve.fraction), None)
    words: dict[str, Any] = {
        "unit": unit,
        "end_diastole": curve.end_diastole,
        "end_systole": curve.end_systole,
        "moments": ["ED", "ES"] if is_ejected else list(moments),
        "is_tracked": readouts.is_tracked,
        "n_openings": readouts.n_openings,
        "figures": [
            _figure(name, unit, *figure, definition=definition)
            for name, definition, figure in zip(
                names, (largest, smallest, difference), figures.values(), strict=True
            )
        ],
        "notes": notes.notes_as_json(readouts.notes),
    }
    if curve.fraction is not None and share is not None:
        definition = "difference of volumes over the largest"
        if is_ejected:
            definition = "stroke volume over end-diastolic volume"
        words["share"] = _figure(curve.fraction.words, "%", *share, definition=definition)
    return words


def _figure(
    name: str, unit: str, value: float, low: float, high: float, **more: Any
) -> dict[str, Any]:
    return {"name": name, "unit": unit, "value": value, "low": low, "high": high, **more}


def _rate_words(
    rates: Rates, readouts: ClinicalReadouts, sequence: MeshSequence
) -> list[dict[str, Any]]:
    start, unit = readouts.stated.end_diastole, readouts.volume_unit
    words = [
        _figure(
            *(f"Peak {name}", f"{unit}/s", rate, rate - bound, rate + bound),
            time_to_peak=_time_from(sequence, start, frame),
        )
        for name, rate, bound, frame in (
            ("ejection", rates.peak_ejection_rate, rates.ejection_bound, rates.ejection_frame),
            ("filling", rates.peak_filling_rate, rates.filling_bound, rates.filling_frame),
        )
    ]
    if rates.cardiac_output is not None and rates.output_range is not None:
        litres, unit = (1e-3, "l") if readouts.unit is not None else (1.0, unit)
        values = (litres * one for one in (rates.cardiac_output, *rates.output_range))
        words.append(_figure("Output", f"{unit}/min", *values, time_to_peak=None))
    return words


def _segment_words(
    regions: segments.RegionalMotion, strain: Strain | None, readouts: ClinicalReadouts
) -> dict[str, Any]:
    end = readouts.mesh_curve.end_systole
    inward = "inward motion over the radius at end diastole"
    quantities = [{"name": "Inward motion", "definition": inward, **_known(regions.shares[end])}]
    if strain is not None and strain.segments == regions.names:
        for k, name in enumerate(("Longitudinal", "Circumferential", "Area")):
            quantities.append(
                {
                    "name": f"{name} strain",
                    "definition": f"{name.lower()} strain since end diastole",
                    **_known(strain.by_segment[end, :, k], strain.segment_deviations[:, k]),
                }
            )
    return {
        "names": list(regions.names),
        "unit": "%",
        "quantities": quantities,
        "end_systole": end,
        "reason": regions.reason,
    }


def _known(values: Floats, deviations: Floats | None = None) -> dict[str, Any]:
    """Values of segments at end systole, None without vertices, and half of each interval."""

    def plain(numbers: Floats) -> list[float | None]:
        return [float(f"{x:.4g}") if np.isfinite(x) else None for x in numbers.tolist()]

    reach = None if deviations is None else plain(volume_curve.TWO_DEVIATIONS * deviations)
    return {"values": plain(values), "reach": reach}


def _classification(answer: Classification | None) -> dict[str, Any]:
    if answer is None:
        return {"classification": None}
    plain = ("model", "label", "probability", "coverage")
    of_part = ("score", "amplitude", "per_unit", "unit")
    parts = [
        {"modes": list(part.modes), **{name: getattr(part, name) for name in of_part}}
        for part in answer.explanation[:8]
    ]
    return {
        "classification": {
            **{name: getattr(answer, name) for name in plain},
            **{name: list(getattr(answer, name)) for name in ("class_set", "flags")},
            "notes": notes.notes_as_json(answer.notes),
            "explanation": parts,
        }
    }


# A part of a wave that has this share of its motion names it alone.
_MOST: Final = 0.5

_ALONG: Final = ("", ", end to end", ", ends against middle")


def wave_name(signature: ModalSignature, template: Template, modes: list[int]) -> str:
    """Name a cosine with its sine by the part that moved most, or by all that they may be.

    Parameters
    ----------
    signature : ModalSignature
    template : Template
    modes : list of int
        Places of the cosine and, where there is one, of its sine.
    """
    label = signature.modes.labels[modes[0]]
    along_normal = signature.kind == SignatureKind.NORMAL_DISPLACEMENT
    components = signature.parameters.components
    all_of_it = mode_names.mode_name(signature, label)
    if along_normal or signature.topology not in (CUP, CYLINDER, SPHERE):
        return all_of_it
    r, around = label.wavenumbers
    a = signature.amplitudes[:, modes] - signature.amplitudes[:, modes].mean(axis=0)
    if components != body_frame.Components.CARTESIAN:
        if around:
            return all_of_it
        names = ("radial contraction", "twist", "longitudinal shortening")
        parts = dict(zip(names, a[:, 0].T, strict=True))
        after = ("", ", end against end", ", ends against middle")
    elif not around and r:
        along = a[:, 0] @ _axes(template)[2]
        rest = np.sqrt(np.maximum((a[:, 0] ** 2).sum(axis=1) - along**2, 0.0))
        parts = {"longitudinal shortening": along, "bending": rest}
        after = ("", "", ", ends against middle")
    elif around == 1 and len(modes) == 2:
        x, y, z = _axes(template)
        (cx, cy, cz), (sx, sy, sz) = ([a[:, k] @ axis for axis in (x, y, z)] for k in (0, 1))
        # cos e_x + sin e_y is the radial direction, cos e_y - sin e_x the tangential one.
        parts = {
            "radial contraction": (cx + sy) / np.sqrt(2.0),
            "twist": (cy - sx) / np.sqrt(2.0),
            "ovalisation": np.hypot(cx - sy, cy + sx) / np.sqrt(2.0),
            "tilting": np.hypot(cz, sz),
        }
        after = _ALONG
    else:
        return all_of_it
    energies = {name: float(path @ path) for name, path in parts.items()}
    name, most = max(energies.items(), key=lambda item: item[1])
    if r >= len(after) or not most >= _MOST * sum(energies.values()) > 0.0:
        return all_of_it
    return name + after[r]


def _axes(template: Template) -> Floats:
    """Directions of theta = 0 and of a quarter turn, and of the axis: rows of (3, 3)."""
    theta = 2.0 * np.pi * template.coordinates[:, 1]
    x, y = (template.weights * np.stack([np.cos(theta), np.sin(theta)])) @ template.vertices
    x = x / (np.linalg.norm(x) or 1.0)
    y = y - (y @ x) * x
    y = y / (np.linalg.norm(y) or 1.0)
    return np.stack([x, y, np.cross(x, y)])
