"""Commands of reports: in files, as DICOM objects, and as a page to view."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from modalmotion.classification.answer import Classification
from modalmotion.cli.files import Waiting, fitted, read, sequence_argument, stated_facts
from modalmotion.cli.options import (
    OutputFolder,
    command,
    fit_options,
    json_option,
    output_option,
    several,
    signature_parameters,
    tell,
)
from modalmotion.cli.track_commands import TRACKING_OPTIONS, tracking_options
from modalmotion.exports.reading import stream_at
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import ModalSignature, modal_signature

if TYPE_CHECKING:
    from modalmotion.mesh.sequence import MeshSequence
    from modalmotion.norm import Norm
    from modalmotion.reports import Report
    from modalmotion.reports.content import Quantity

report_options = several(
    sequence_argument,
    click.option("--model", help="Model: the name of an included one, or a file; none by default."),
    click.option(
        "--norm",
        "norm_file",
        type=click.Path(exists=True, path_type=Path),
        help="Norm of your own controls, a file.",
    ),
    click.option(
        "--issued",
        help="Time of the result, as 2026-01-31T12:00:00+00:00; now by default. The same time "
        "gives the same bytes.",
    ),
    tracking_options,
    fit_options,
)
"""Source of a recording, and its options."""


@dataclass(frozen=True)
class Wanted:
    """Source and options of a report, checked before the work.

    Parameters
    ----------
    source : Path
    issued : datetime
    model : str or None
    norm : Norm or None
    tracking : dict
        Landmarks, labels, wall, contours and papillary convention of what is tracked first.
    options : dict
        Of reading and of the signature.
    """

    source: Path
    issued: datetime
    model: str | None
    norm: Norm | None
    tracking: dict[str, Any]
    options: dict[str, Any]

    @staticmethod
    def of(
        source: Path,
        model: str | None,
        norm_file: Path | None,
        issued: str | None,
        **options: Any,
    ) -> Wanted:
        """Read the options, and refuse wrong ones at once."""
        from modalmotion.cli.model_commands import model_named
        from modalmotion.norm import norm_from_hdf5

        if model is not None:
            model_named(model)
        norm = None if norm_file is None else norm_from_hdf5(norm_file)
        tracking = {name: options.pop(name) for name in TRACKING_OPTIONS}
        return Wanted(source, _time(issued), model, norm, tracking, options)

    def report(self, waiting: Waiting) -> Report:
        """Make the report."""
        from modalmotion.classification import classify, shipped_for
        from modalmotion.cli.model_commands import model_named
        from modalmotion.reports import report_of

        parameters = signature_parameters(self.options)
        sequence = self._sequence(waiting)
        signature = modal_signature(sequence, parameters, watch=waiting.watch)
        answer = deviation = None
        if self.model is not None:
            with waiting.watch.stage("class"):
                # Of the included models the one for the kind of points.
                answer = classify(sequence, model_named(shipped_for(self.model, sequence.facts)))
        if self.norm is not None:
            with waiting.watch.stage("controls"):
                deviation = self.norm.deviation(sequence)
        return report_of(
            signature, sequence, issued=self.issued, classification=answer, deviation=deviation
        )

    def _sequence(self, waiting: Waiting) -> MeshSequence:
        """Read the sequence, or track one through images, points or contours."""
        from modalmotion.formats.volumes.reading import holds_images
        from modalmotion.tracking.reading import holds_contours, read_observed

        with waiting.watch.stage("read"):
            named = dict(self.tracking)
            landmarks, contours = named.pop("landmarks"), named["contours"]
            is_stated = bool(landmarks or named["labels"])
            if not (is_stated or holds_images(self.source) or holds_contours(self.source)):
                return read(self.source, **self.options)
            from modalmotion.cli.track_commands import stated_landmarks
            from modalmotion.tracking.parameters import TrackParameters

            recorded = read_observed(self.source, contours=contours)
            unit = self.options["unit"]
            marks = stated_landmarks(landmarks, recorded, unit)
        with waiting.watch.stage("track"):
            parameters = TrackParameters(
                landmarks=marks,
                unit=unit,
                times=self.options["frame_interval"],
                facts=stated_facts(dict(self.options)),
                **named,
            )
            return parameters.follow(recorded).sequence


def _time(issued: str | None) -> datetime:
    if issued is None:
        return datetime.now(UTC)
    try:
        return datetime.fromisoformat(issued)
    except ValueError:
        raise click.BadParameter(
            f"{issued!r} is not a time; write it as 2026-01-31T12:00:00+00:00.",
            param_hint="--issued",
        ) from None


@command("report map.nii.gz -o folder")
@report_options
@click.option(
    "-o",
    "--out",
    required=True,
    type=OutputFolder(".pdf", ".json", ".csv", ".html"),
    help="Folder to write; or one file: .pdf, .json (FHIR), .csv or .html.",
)
@json_option
def report(source: Path, out: Path, as_json: bool, **options: Any) -> None:
    """Report on the sequence in FILE: PDF, FHIR, CSV and HTML.

    FILE may also be a label map, which is tracked first; or images, points or contours, with
    --landmarks. A folder gets report.pdf, report.fhir.json, frames.csv and view.html, all marked as
    preliminary.
    """
    from modalmotion.reports.content import OWN, quantities_of
    from modalmotion.reports.writing import write_report
    from modalmotion.viewer.page import View

    wanted = Wanted.of(source, **options)
    with Waiting(source) as waiting:
        found = wanted.report(waiting)
        with waiting.watch.stage("write"):
            answer = found.classification
            view = View(found.signature, found.sequence, source.name, classification=answer)
            paths = write_report(found, out, view)
    quantities = quantities_of(found)
    said = [f"{OWN[q.name]:<32}{_interval(q)}" for q in quantities]
    said += [f"note: {note}" for note in found.caveats]
    numbers = {"quantities": [asdict(q) for q in quantities], "notes": found.caveats}
    tell(numbers, said, *paths, as_json=as_json)


def _interval(q: Quantity) -> str:
    return f"{q.value:8.1f} {q.unit} ({q.low:.1f} to {q.high:.1f})"


@command("dicom beat.npz --study image.dcm --coordinates LPS --cavity lv -o folder")
@report_options
@click.option("-o", "--out", required=True, type=OutputFolder(), help="Folder to write.")
@click.option(
    "--study",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Any instance of the patient's study: its header is copied, and its pixels are not read.",
)
@json_option
def dicom(source: Path, out: Path, study: Path, as_json: bool, **options: Any) -> None:
    """Write a DICOM structured report and surfaces of the sequence in FILE.

    The folder gets report.dcm (TID 1500) and the surfaces at the ends of diastole and systole as
    encapsulated STL, as instances of the patient's study. Coordinates must be stated as LPS, in
    mm. Needs pydicom and highdicom (extra dicom).
    """
    from modalmotion.reports.dicom import dicom_instances, read_study, require_space
    from modalmotion.store import write_atomic

    wanted = Wanted.of(source, **options)
    header = read_study(study)
    with Waiting(source) as waiting:
        found = wanted.report(waiting)
        require_space(found.sequence.facts, found.sequence.unit)
        with waiting.watch.stage("write"):
            pieces = dicom_instances(found, header)
            out.mkdir(parents=True, exist_ok=True)
            for name, data in pieces.items():
                write_atomic(out / name, data)
    said = [f"note: {note}" for note in found.caveats]
    tell({"notes": found.caveats}, said, *(out / name for name in pieces), as_json=as_json)


@command("view beat.npz -o beat.html")
@sequence_argument
@output_option("Page to write.", ".html")
@click.option(
    "--with",
    "other",
    type=click.Path(exists=True, path_type=Path),
    help="A second file, shown beside the first with a common clock and camera.",
)
@click.option(
    "--classify/--no-classify",
    default=True,
    show_default=True,
    help="Show the class by the included model.",
)
@json_option
@fit_options
def view(
    source: Path,
    output: Path,
    other: Path | None,
    classify: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Write an HTML page of the moving surface in FILE, with its reconstruction.

    The page is one file: it opens from disk in any browser and needs no network. For a track (.h5)
    the data are drawn over the surface. If FILE is a compressed
    stream, the page contains it and decodes it.
    """
    from modalmotion.store import write_atomic
    from modalmotion.tracking.hdf5 import kept_track
    from modalmotion.viewer.page import View, view_page

    views = []
    with Waiting(source) as waiting:
        for path in filter(None, (source, other)):
            sequence, signature = fitted(path, waiting, {**options})
            answer = _answer(sequence, signature) if classify else None
            tracked = kept_track(path)
            data = None if tracked is None else tracked.data
            stream = _stream(path, sequence)
            views.append(
                View(signature, sequence, path.name, None, answer, data=data, stream=stream)
            )
        with waiting.watch.stage("write"):
            write_atomic(output, view_page(views).encode())
    tell({"titles": [view.title for view in views]}, [], output, as_json=as_json)


def _answer(sequence: MeshSequence, signature: ModalSignature) -> Classification | None:
    """Classify by the shipped model, which knows ventricles only."""
    from modalmotion.classification import classify

    return classify(sequence) if signature.topology == CUP else None


def _stream(path: Path, sequence: MeshSequence) -> bytes | None:
    """Give the bytes of a compressed file, if a page can decode them to this sequence."""
    from modalmotion.codec import decode, inspect
    from modalmotion.codec.spatial_modes import STORED

    data = stream_at(path)
    if data is None or inspect(data).modes == STORED:
        return None
    # Options of reading may have changed the order of frames.
    return data if np.array_equal(decode(data).vertices, sequence.vertices) else None
