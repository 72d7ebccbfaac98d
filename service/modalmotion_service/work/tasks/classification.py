"""Classes named by models, models measured, norms made and asked, features tabulated."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from modalmotion import store
from modalmotion.classification import (
    CaseFile,
    Model,
    ModelCard,
    classify,
    feature_table,
    load_model,
    shipped_for,
)
from modalmotion.classification.cases import LeftOut, TrainingCase, case_name
from modalmotion.classification.evaluation import CaseAnswer, comparison_of, evaluation_of
from modalmotion.mesh.facts import Facts
from modalmotion.norm import Norm, cohort_deviation, norm_from_hdf5, norm_to_hdf5, train_norm
from modalmotion.norm.norm import Reading
from modalmotion.progress import part_of
from modalmotion.signature.making import SignatureParameters
from modalmotion_service.http.negotiation import CSV, PNG
from modalmotion_service.schemas import models
from modalmotion_service.schemas.general import ReadingAnswer
from modalmotion_service.schemas.results import ClassificationAnswer, UploadClassificationAnswer
from modalmotion_service.work.tasks.files import Fitted, ProgressFile, png_of, write_whole
from modalmotion_service.work.upload import Upload


def name_class(
    signature: Path, model: Path | str, coverage: float, stated: str | None, facts: Facts, key: str
) -> tuple[bytes, str | None]:
    """Ask a model for the class of a kept signature's motion.

    Parameters
    ----------
    signature : Path
    model : Path or str
    coverage : float
    stated : str or None
        Topology that the sequence states.
    facts : Facts
        Of the sequence; kept signatures have none.
    key : str
        Under which the answer is kept.

    Returns
    -------
    image : bytes
        HDF5 file of the classification.
    imposed : str or None
        The topology in which the model would rather have the sequence, which states none.
    """
    asked = loaded(model)
    kept = replace(store.signature_from_hdf5(signature), facts=facts)
    imposed = asked.readable.imposed_on(kept.surface, stated)
    image = store.classification_to_hdf5(classify(kept, asked, coverage), parameters_key=key)
    return image, None if imposed is None else imposed.topology


def classify_upload(
    upload: Upload,
    parameters: SignatureParameters,  # noqa: ARG001 (they are the model's; its price is read here)
    model: Path | str,
    coverage: float,
    version: int,
) -> bytes:
    """Read an upload, fit it, and ask a model for the class of its motion; as JSON."""
    reading = upload.read()
    if isinstance(model, str):
        model = shipped_for(model, reading.sequence.facts)
    found = ClassificationAnswer.of(classify(reading.sequence, loaded(model), coverage), version)
    answer = UploadClassificationAnswer(**found.model_dump(), reading=ReadingAnswer.of(reading))
    return answer.model_dump_json().encode()


def draw_card(card: dict[str, Any], title: str) -> bytes:
    """Draw the confusion matrix and the calibration curve of a card, as PNG."""
    from modalmotion.pictures.classification import card_figure

    return png_of(card_figure(ModelCard.from_json(card), title))


# A file of a model never changes, and a version is never given twice.
@lru_cache(maxsize=8)
def loaded(model: Path | str) -> Model:
    """Load a model, or give the one that was loaded before."""
    return store.model_from_hdf5(model) if isinstance(model, Path) else load_model(model)


Source = Path | str


def measure(
    chosen: Sequence[Source],
    versions: Sequence[int],
    answers: Sequence[Sequence[CaseAnswer]],
    coverage: float,
    media_type: str,
) -> bytes:
    """Measure a model's answers, as JSON, a table of the cases, or a picture; or compare two."""
    results = [
        evaluation_of(loaded(model), its, coverage)
        for model, its in zip(chosen, answers, strict=True)
    ]
    first, *others = results
    if others:
        answer = models.ComparisonAnswer.of(comparison_of(first, others[0]), versions)
        return answer.model_dump_json().encode()
    if media_type == CSV:
        return first.as_csv().encode()
    if media_type == PNG:
        from modalmotion.pictures.classification import evaluation_figure

        return png_of(evaluation_figure(first))
    return models.EvaluationAnswer.of(first, versions[0]).model_dump_json().encode()


def held_out_table(model: Source, subjects: dict[str, str]) -> bytes:
    """Give the held-out answers of a model's cross-validation as a table; empty without one.

    Parameters
    ----------
    model : Path or str
    subjects : dict of str to str
        Of recordings, by id, as they are known now.
    """
    validation = loaded(model).cross_validation
    if validation is None:
        return b""
    return validation.as_csv({id_: ("", subject) for id_, subject in subjects.items()}).encode()


def held_out_ids(model: Source) -> list[str]:
    """Ids of the recordings that a model was trained on; none where its file does not say."""
    validation = loaded(model).cross_validation
    return [] if validation is None else list(validation.sequence_ids)


def tabulate_features(
    cases: Sequence[CaseFile],
    options: dict[str, Any],
    on_error: str,
    left_out: Sequence[LeftOut],
    media_type: str,
    output: Path,
) -> int:
    """Write the features of kept signatures as CSV or JSON; gives the number of cases left out.

    Parameters
    ----------
    cases : sequence of CaseFile
    options : dict
        Of `SignatureFeatures`.
    on_error : str
    left_out : sequence of LeftOut
        Cases whose signatures could not be made.
    media_type : str
    output : Path

    Raises
    ------
    ModalMotionError
        If they do not compare, or have not the features that the options name.
    """
    # Here, for the server, which only hands this on, needs no scikit-learn.
    from modalmotion.classification import SignatureFeatures

    table = feature_table(cases, SignatureFeatures(**options), on_error=on_error)
    table = table.beside(left_out)
    text = (
        table.as_csv() if media_type == CSV else models.FeaturesAnswer.of(table).model_dump_json()
    )
    write_whole(output, text.encode())
    return len(table.left_out)


def make_norm(
    recordings: Sequence[Fitted],
    name: str,
    modes: int,
    topology: str | None,
    image: Path,
    progress: Path,
) -> None:
    """Make a norm of kept controls and write its HDF5 image; see `train_norm`."""
    report = part_of(ProgressFile(progress).write, 0.0, 1.0, "controls")
    controls = [
        TrainingCase(
            one.read_signature(),
            "",
            one.record.subject,
            case_name(one.record.id),
            # Read one after another, when its turn comes.
            sequence=one.read_sequence if one.record.has_upload else None,
        )
        for one in recordings
    ]
    norm = train_norm(controls, name, modes=modes, topology=topology, progress=report)
    write_whole(image, norm_to_hdf5(norm))


def ask_norm(
    recordings: Sequence[Fitted], norm: Path, level: float, stated: Sequence[str | None]
) -> tuple[bytes, dict[int, str]]:
    """Compare kept sequences with a norm, each, and many together; gives the answer as JSON.

    Parameters
    ----------
    recordings : sequence of Fitted
    norm : Path
    level : float
    stated : sequence of (str or None)
        Topology that each sequence states.

    Returns
    -------
    bytes, dict of int to str
        Without an answer the topologies in which the norm would rather have some, by number.
    """
    controls = norm_from_hdf5(norm)
    readings, imposed = [], {}
    for number, (one, topology) in enumerate(zip(recordings, stated, strict=True)):
        own, wanted = _read(one, controls, topology)
        if own is not None:
            readings.append(own)
        elif wanted is not None:
            imposed[number] = wanted
    if imposed:
        return b"", imposed
    found = cohort_deviation(controls, readings, level=level)
    answer = models.CohortDeviationAnswer(**found.as_json())
    return answer.model_dump_json().encode(), {}


def _read(
    recording: Fitted, controls: Norm, stated: str | None
) -> tuple[Reading | None, str | None]:
    """Read a recording as the controls are; or give the topology in which they rather have it."""
    signature = recording.read_signature()
    imposed = controls.readable.imposed_on(signature.surface, stated)
    if imposed is not None and imposed.topology is not None:
        return None, str(imposed.topology)
    own = controls.read(
        signature,
        subject=recording.record.subject,
        name=case_name(recording.record.id),
        sequence=recording.read_sequence() if recording.record.has_upload else None,
    )
    return own, None
