"""Commands of clinical read-outs, of a comparison with known motion, and of norms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
import numpy as np

from modalmotion import clinical, errors, store
from modalmotion.cli import report_commands, shared, track_commands
from modalmotion.cli.files import Waiting, each_labelled, read, sequence_argument
from modalmotion.clinical.ventricle import readouts_json, ventricle_readouts
from modalmotion.notes import Note
from modalmotion.pictures.readouts import bulls_eye_figure, most_moved, volume_figure
from modalmotion.representation import counted, numeral
from modalmotion.signature.mode_names import direction_names

if TYPE_CHECKING:
    from modalmotion import classification, reports
    from modalmotion.clinical.ventricle import VentricleReadouts


@shared.command("readouts beat.npz --modes 18 -o volumes.png")
@sequence_argument
@track_commands.tracking_options
@shared.fit_options
def readouts(
    source: Path, plot: shared.OnlyPlot = None, bulls_eye: shared.Plot = None, **options: Any
) -> Any:
    """Compute volume, ejection fraction and strain of the cavity in FILE, with intervals.

    The relative change of volume is an ejection fraction if --cavity is given or the surface is a
    cup, otherwise a volume change. A label map is tracked first, as by `modalmotion report`.

    Parameters
    ----------
    plot
        Picture to write (.png, .svg, .pdf).
    bulls_eye
        Picture to write of the inward motion by segment (.png, .svg, .pdf).
    """
    from modalmotion import reports

    with Waiting(source) as waiting:
        sequence, signature = track_commands.fitted_recording(source, waiting, options)
        with waiting.watch.stage("volume"):
            result = clinical.clinical_readouts(signature, sequence)
            ventricle = ventricle_readouts(signature, sequence, result)
    if plot is not None:
        shared.write_picture(volume_figure(result), plot)
    if bulls_eye is not None:
        if ventricle.regions is None:
            raise errors.TopologyError(
                "This surface has no segments to draw.",
                remedy="Leave --bulls-eye out: segments are those of a cup, a ventricle's wall.",
            )
        shared.write_picture(bulls_eye_figure(ventricle.regions), bulls_eye)
    found = reports.Report(
        signature, sequence, result, ventricle, None, None, datetime.now(UTC), ()
    )
    return readouts_json(result, ventricle), _lines(found, result, ventricle)


def _lines(
    report: reports.Report, readouts: clinical.ClinicalReadouts, ventricle: VentricleReadouts
) -> Iterator[str]:
    unit, curve = readouts.volume_unit, readouts.stated
    capped = ", capped" if readouts.n_openings else ""
    yield f"{counted(readouts.n_openings, 'opening')}{capped}"
    yield from report_commands.quantity_lines(report)
    yield f"end diastole in frame {curve.end_diastole}, end systole in {curve.end_systole}"
    said: dict[str, dict[str, str]] = {}
    if (rates := ventricle.rates) is not None:
        of_rates = said["rates"] = {}
        for name, value, bound in (
            ("peak_ejection_rate", rates.peak_ejection_rate, rates.ejection_bound),
            ("peak_filling_rate", rates.peak_filling_rate, rates.filling_bound),
        ):
            of_rates[name] = f"{numeral(value, 1)} +- {numeral(bound, 1)} {unit}/s"
        if rates.heart_rate is not None and rates.cardiac_output is not None:
            of_rates["heart_rate"] = f"{rates.heart_rate:.1f} /min"
            of_rates["cardiac_output"] = f"{numeral(rates.cardiac_output, 1)} {unit}/min"
    if (strain := ventricle.strain) is not None:
        key = f"strain in frame {strain.end_systole} of {strain.source}, {strain.layer}"
        said[key] = {name: str(one) for name, one in strain.end_systolic.items()}
    if (turning := ventricle.torsion) is not None:
        k = turning.end_systole
        said["torsion, degrees"] = {
            "twist": f"{turning.twist[k]:.1f} +- {2.0 * turning.twist_deviations[k]:.1f}",
            "shear": f"{turning.shear[k]:.1f} +- {2.0 * turning.shear_deviations[k]:.1f}",
        }
    if (per_mode := ventricle.per_mode) is not None:
        directions, largest = direction_names(report.signature), {}
        for name, what, values in zip(per_mode.names, per_mode.units, per_mode.values, strict=True):
            mode, way = np.unravel_index(np.abs(values).argmax(), values.shape)
            place = f"mode {per_mode.labels[mode]}, {directions[way]}"
            largest[name] = f"{values[mode, way]:.2f} {what}, {place}"
        step = report.signature.unit or "length unit"
        said[f"largest effect of 1 {step} of an amplitude"] = largest
    if (regions := ventricle.regions) is not None:
        frame = most_moved(regions)
        shares = zip(regions.names, regions.shares[frame], strict=True)
        key = f"inward motion over the radius at end diastole, frame {frame}, %"
        said[key] = {name: f"{share:.1f}" for name, share in shares}
    yield from shared.described({**said, "notes": (*readouts.notes, *ventricle.reasons)})


@shared.command("score truth.npz answer.h5")
@click.argument("truth", type=shared.EXISTING_FILE)
@click.argument("answer", type=shared.EXISTING_FILE)
def score(truth: Path, answer: Path) -> Any:
    """Compare the motion in ANSWER with the true one in TRUTH: errors in mm and in points.

    ANSWER is a track (.h5), with its deviations, or a sequence in any format; .npz may contain
    `deviations` (frames, vertices), mm.
    """
    from modalmotion.clinical.score import PUBLISHED
    from modalmotion.clinical.score import score as scored
    from modalmotion.formats.npz import read_arrays
    from modalmotion.tracking.hdf5 import track_from_hdf5

    deviations = None
    if answer.suffix.lower() in (".h5", ".hdf5"):
        found = track_from_hdf5(answer)
        estimated, deviations = found.sequence, found.deviations[:, :, 0]
    else:
        estimated = read(answer, beside=["deviations"])
        if answer.suffix.lower() == ".npz":
            deviations = read_arrays(answer.read_bytes(), ["deviations"], [])[0].get("deviations")
    result = asdict(scored(read(truth), estimated, deviations))
    return result, shared.described(
        {**result, "notes": [Note.of("published_errors", mm=PUBLISHED)]}
    )


@click.group()
def norm() -> None:
    """Compare recordings with your own controls."""


@shared.command("norm train controls.csv --name volunteers -o volunteers.h5", group=norm)
@shared.labelled_sources
def train(
    sources: tuple[Path, ...],
    skip_unreadable: bool,
    name: str,
    out: Annotated[Path, shared.OutputFile()],
    unit: str | None = None,
    modes: int = 7,
    topology: str | None = None,
) -> Any:
    """Make a norm from recordings of controls, one per person.

    MANIFEST is a table with the column path and, if known, subject and facts; labels are ignored.
    FILES are files of sequences.

    Parameters
    ----------
    name
        Of the norm: lower-case letters, digits, '._-'.
    out
        File to write (HDF5).
    unit
        Length unit of all files; overrides their own.
    modes
        Modes of the signatures; 3 amplitudes per frame.
    topology
        cup, sphere, ..., or mesh for spring modes; found from all controls by default.
    """
    from modalmotion.classification.cases import left_out_notes
    from modalmotion.norm import norm_to_hdf5, train_norm

    cases, left_out = each_labelled(sources, lambda case: case, skips=skip_unreadable, unit=unit)
    result = train_norm(cases, name=name, modes=modes, topology=topology)
    store.write_atomic(out, norm_to_hdf5(result))
    return {**result.as_json(), "left_out": list(left_out_notes(left_out))}


@shared.command("norm ask volunteers.h5 beat.npz", group=norm)
@click.argument("norm_file", metavar="NORM", type=shared.EXISTING)
@shared.labelled_sources
def ask(
    norm_file: Path,
    sources: tuple[Path, ...],
    skip_unreadable: bool,
    level: float = 0.05,
    unit: str | None = None,
) -> Any:
    """Compare recordings with the controls of NORM, a file.

    Five or more are also compared together, with a warning if scanner or protocol differ. MANIFEST
    and FILES are as for training.

    Parameters
    ----------
    level
        Level: share of recordings like the controls that are reported as deviating.
    unit
        Length unit of all files; overrides their own.
    """
    from modalmotion.classification.cases import left_out_notes
    from modalmotion.norm import cohort_deviation, norm_from_hdf5

    controls = norm_from_hdf5(norm_file)

    def compared(case: classification.TrainingCase) -> Any:
        return controls.read(case.motion, subject=case.subject, name=case.name)

    readings, left_out = each_labelled(sources, compared, skips=skip_unreadable, unit=unit)
    notes = list(left_out_notes(left_out))
    together = cohort_deviation(controls, readings, level=level)
    answers = [(r.name, one) for r, one in zip(readings, together.deviations, strict=True)]
    lines = [f"{name}\n{answer.lines}" for name, answer in answers]
    if together.p is not None:
        lines.append(f"together: p = {together.p:.3g} of {controls.n_controls} like controls")
        lines += [f"warning: {together.warning}"] * (together.warning is not None)
    found = {
        "cohort": None if together.p is None else together.as_json(),
        "deviations": [{"path": name, **answer.as_json()} for name, answer in answers],
        "left_out": notes,
    }
    return found, [*lines, *map(str, notes)]
