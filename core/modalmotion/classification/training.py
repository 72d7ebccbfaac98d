"""Training of a model. scikit-learn is imported here, and only when a model is trained."""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from modalmotion.classification import caveats, model, motion_features, outliers
from modalmotion.classification.card import ModelCard
from modalmotion.classification.cases import AnyCase
from modalmotion.classification.cohort import Cohort, collect_cohorts
from modalmotion.classification.fitting import (
    Fit,
    Fold,
    Folds,
    Splits,
    better,
    fit_rows,
    split_cases,
    tables_of,
)
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.performance import METHODS, CrossValidation, performance
from modalmotion.errors import ParameterError, needs_extra
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.notes import Note
from modalmotion.progress import Reporter, part_of, reported, silent
from modalmotion.representation import Array, Bools, Floats, Ints

# Share of the progress that reading the cases is counted as.
_READ: Final = 0.4

# Level of the card's class sets, and cases of a class below which these always hold it.
_COVERAGE: Final = 0.9
_FEW: Final = 9

# Fewer cases than these, in all or of a class, make figures that say little.
_FEW_IN_ALL: Final = 10
_FEW_OF_A_CLASS: Final = 5

# Digits that a model keeps: more would differ between numbers of threads.
_DIGITS: Final = 9


def train(
    cases: Iterable[AnyCase],
    name: str,
    options: TrainingOptions | None = None,
    progress: Reporter | None = None,
    cv: Folds | None = None,
    normal_displacements: Iterable[AnyCase] | None = None,
) -> model.Model:
    """Train a model on labelled recordings.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Sequences are fitted; signatures are read as they are.
    name : str
    options : TrainingOptions, optional
    progress : callable, optional
        Called with the share that is done.
    cv : sequence of int, optional
        Folds of your own: for each case the number of the fold in which it is predicted.
    normal_displacements : iterable of TrainingCase or CaseSource, optional
        The same cases with their signatures of normal displacements, where `cases` are signatures
        and both kinds are to be weighed. Sequences are fitted in both by themselves.

    Returns
    -------
    Model

    Raises
    ------
    ParameterError
        If a label is missing, a case cannot be used or does not compare with the others, one
        recording has two classes, or there are fewer than two classes.
    ModalMotionError
        If a case cannot be read or fitted.

    Notes
    -----
    Tables, weights and temperatures are chosen anew within each fold, so that accuracy, calibration
    and class sets are of cases that took no part in anything. Cases are read and folds are fitted
    through joblib: wherever `joblib_backend`, or joblib's own `parallel_config`, says. The model
    does not depend on it.
    """
    from joblib import Parallel, delayed
    from threadpoolctl import threadpool_limits

    # Threads for matrices of a few dozen rows wait for one another: twice the processor's time.
    with threadpool_limits(limits=1, user_api="blas"):
        chosen, report = options or TrainingOptions(), progress or silent
        reading, fitting = part_of(report, 0.0, _READ), part_of(report, _READ, 1.0)
        cohorts = collect_cohorts(cases, normal_displacements, chosen, reading)
        splits = split_cases(cohorts[0], chosen, cv)
        # Those of a basis have its motions in memory, so each is one piece of work.
        works = (delayed(_fitted)(cohort, splits, chosen) for cohort in cohorts)
        fitted = Parallel(return_as="generator", batch_size=1)(works)
        results = list(reported(fitted, fitting, len(cohorts)))
        final = better([result.final for result in results])
        held_out = _held_out(results, splits, cohorts[final])
        cohort, fit = cohorts[final], results[final].final
        card, warning = _card(cohort, chosen, splits, held_out, fit)
        losses = (
            f"{c.basis} {r.final.losses.mean():.3f}" for c, r in zip(cohorts, results, strict=True)
        )
        chosen_of = Note.of("basis_chosen", basis=cohort.basis, losses=", ".join(losses))
        weighed = (chosen_of,) * (len(cohorts) > 1)
        card = replace(card, notes=(*cohort.notes, *weighed, *splits.notes, *card.notes, *warning))
        always = (*warning, *_always(cohort, fit))
        return _model(cohort, name, results[final], held_out, card, always)


@contextmanager
def joblib_backend(
    scheduler: str | None = None,
    n_jobs: int = -1,
    *,
    threads: bool = False,
    connect_seconds: float = 30.0,
) -> Iterator[None]:
    """Have joblib work on a Dask scheduler's workers, or in processes or threads here.

    Whatever uses joblib inside the block and leaves its own `n_jobs` at None, such as
    cross-validation in scikit-learn, is shared out; results do not depend on where.

    Parameters
    ----------
    scheduler : str, optional
        Address such as tcp://host:8786; its workers need this package.
    n_jobs : int
        Pieces of work at once on this machine; -1 for as many as there are cores. On a
        scheduler its workers decide.
    threads : bool
        Threads in place of processes: in a worker of the service, whose memory is limited as a
        whole.
    connect_seconds : float

    Raises
    ------
    ParameterError
        If there is no such scheduler, or it has no workers.
    MissingExtraError
        If `distributed` is not installed.
    """
    import joblib

    if scheduler is None:
        with joblib.parallel_config("threading" if threads else "loky", n_jobs=n_jobs):
            yield
        return
    with needs_extra("cluster"):
        from distributed import Client
    try:
        client = Client(scheduler, set_as_default=False, timeout=connect_seconds)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"There is no scheduler at '{scheduler}': {error}.",
            remedy="Start it, or correct the address.",
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=connect_seconds)
        except TimeoutError as error:
            raise ParameterError(
                f"The scheduler at '{scheduler}' has no workers.",
                remedy="Start some: dask worker ADDRESS.",
            ) from error
        with joblib.parallel_config("dask", client=client):
            yield


class _Result(NamedTuple):
    """Fits to all cases and to those of each fold, and what a detector says of cases left out.

    Parameters
    ----------
    final : Fit
    folds : list of (Fit, (cases, classes) float64)
        Of all repetitions, without their tables, and the scores of the cases that are predicted.
    detector : OutlierDetector
        With its limits.
    """

    final: Fit
    folds: list[tuple[Fit, Floats]]
    detector: outliers.OutlierDetector


def _fitted(cohort: Cohort, splits: Splits, options: TrainingOptions) -> _Result:
    tables, folds = tables_of(cohort, options), []
    for inner, outer in itertools.chain(*splits.repetitions):
        fit = fit_rows(cohort, tables, inner)
        folds.append((replace(fit, tables=()), fit.scores(outer)))
    simplest = tables[0].extractor
    what = motion_features.AXIS if simplest.what == motion_features.AXIS else motion_features.WAVES
    detector = outliers.detector_for(
        cohort.motions,
        cohort.y,
        replace(simplest, what=what),
        splits.repetitions[0] if splits.repetitions else (),
        cohort.groups if splits.is_grouped else np.arange(len(cohort)),
    )
    return _Result(fit_rows(cohort, tables, np.arange(len(cohort))), folds, detector)


def _held_out(results: Sequence[_Result], splits: Splits, cohort: Cohort) -> CrossValidation | None:
    """Put the answers of all folds together, each by the basis that the fold chose."""
    if not splits.repetitions:
        return None
    shape = (len(splits.repetitions), len(cohort))
    probabilities = np.zeros((*shape, len(cohort.classes)))
    numbers = np.zeros(shape, dtype=np.int64)
    place = 0
    for r, repetition in enumerate(splits.repetitions):
        for k, (_, outer) in enumerate(repetition):
            fits = [result.folds[place] for result in results]
            scores = fits[better([fit for fit, _ in fits])][1]
            probabilities[r, outer] = scipy.special.softmax(scores, axis=1)
            numbers[r, outer] = k
            place += 1
    return CrossValidation(
        classes=cohort.classes,
        sequence_ids=cohort.sequence_ids,
        names=cohort.names,
        subjects=cohort.subjects,
        y=cohort.y,
        # Figures too must not depend on the number of threads.
        probabilities=_rounded(probabilities),
        folds=numbers,
    )


def _model(
    cohort: Cohort,
    name: str,
    result: _Result,
    held_out: CrossValidation | None,
    card: ModelCard,
    notes: tuple[Note, ...],
) -> model.Model:
    tables, example, n = result.final.tables, cohort.motions[0], len(cohort.classes)
    X = np.concatenate([one.table.X for one in tables], axis=1)
    shares = np.array([motion_features.volume_share(motion) for motion in cohort.motions])
    strangeness: tuple[Floats, ...] = tuple(np.zeros(0) for _ in cohort.classes)
    if held_out is not None:
        strangeness = model.strangeness_of(held_out.probabilities[0], cohort.y)
    extractors = tuple(one.table.extractor for one in tables)
    rounded: dict[str, Any] = {k: _rounded(getattr(result.detector, k)) for k in model.OF_DETECTOR}
    return model.Model(
        name=name,
        classes=cohort.classes,
        readable=cohort.readable,
        tables=extractors,
        columns=tuple(column for one in extractors for column in one.columns(example)),
        weights=_rounded(np.concatenate([table.linear.weights for table in tables])),
        intercepts=_rounded(np.sum([table.linear.intercepts for table in tables], axis=0)),
        centre=_rounded(X.mean(axis=0)),
        outliers=replace(result.detector, **rounded),
        shares=_rounded(model.share_ranges(shares, cohort.y, n)),
        strangeness=strangeness,
        notes={"": notes},
        card=card,
        cross_validation=held_out,
    )


def _rounded(values: Array) -> Array:
    numbers = [float(f"{x:.{_DIGITS}g}") for x in np.ravel(values).view(np.float64)]
    return np.array(numbers).view(values.dtype).reshape(values.shape)


def _card(
    cohort: Cohort,
    options: TrainingOptions,
    splits: Splits,
    held_out: CrossValidation | None,
    fit: Fit,
) -> tuple[ModelCard, tuple[Note, ...]]:
    """Card of a trained model, and the warning that every answer carries, if any."""
    labels = [cohort.classes[k] for k in cohort.y]
    people = dict.fromkeys(zip(labels, cohort.subjects, strict=True))
    counts = Counter(labels), Counter(label for label, _ in people)
    n_cases, n_subjects = (dict(sorted(count.items())) for count in counts)
    features = tuple((one.table.extractor.description, round(one.weight, 3)) for one in fit.tables)
    card = ModelCard(
        classes=cohort.classes,
        training_set=cohort.hash,
        n_cases=n_cases,
        n_subjects=n_subjects,
        coverage=_COVERAGE,
        options={
            **options.as_json(),
            "kind": cohort.readable.parameters.kind,
            "features": features,
        },
        versions={p: version(p) for p in ("modalmotion", "numpy", "scipy", "scikit-learn")},
        intended_use=INTENDED_USE,
        has_seen=(
            f"{len(cohort)} recordings of {len(set(cohort.subjects))} subjects: "
            + ", ".join(f"{count} {label}" for label, count in n_cases.items())
            + f"; {cohort.readable.topology}, {cohort.readable.n_modes} modes."
        ),
        has_not_seen=(
            "Any other class, subject, device or segmentation method: the figures are valid for "
            "similar recordings only."
        ),
        is_grouped=splits.is_grouped,
        notes=_notes_on_few(n_cases),
    )
    if held_out is None:
        return card, ()
    figures = performance(held_out.answers())
    persons = np.unique(cohort.subjects, return_inverse=True)[1]
    tests = caveats.confounds(cohort.conditions, cohort.y, persons, options.seed)
    held, sizes = _cross_sets(cohort, splits.repetitions[0], held_out.probabilities[0])
    warning: tuple[Note, ...] = ()
    if figures.auc_interval is not None and figures.auc_interval[0] <= 0.5:
        low, high = figures.auc_interval
        warning = (Note.of("no_better_than_chance", auc=figures.auc, low=low, high=high),)
    return replace(
        card,
        **vars(figures),
        methods=METHODS,
        repetitions=len(held_out.probabilities),
        confounds=tests,
        notes=(*card.notes, *caveats.confound_notes(tests)),
        class_coverage={
            label: float(held[cohort.y == k].mean()) for k, label in enumerate(cohort.classes)
        },
        mean_set_size=float(sizes.mean()),
    ), warning


def _cross_sets(cohort: Cohort, folds: Sequence[Fold], probabilities: Floats) -> tuple[Bools, Ints]:
    """Whether each case's set, calibrated on the other folds, contains its class; and its size."""
    held = np.zeros(len(cohort), dtype=np.bool_)
    sizes = np.zeros(len(cohort), dtype=np.int64)
    for inner, outer in folds:
        others = model.strangeness_of(probabilities[inner], cohort.y[inner])
        in_set = model.holds(others, probabilities[outer], _COVERAGE)
        held[outer] = in_set[np.arange(len(outer)), cohort.y[outer]]
        sizes[outer] = in_set.sum(axis=1)
    return held, sizes


def _notes_on_few(n_cases: dict[str, int]) -> tuple[Note, ...]:
    notes, n = [], sum(n_cases.values())
    if n < _FEW_IN_ALL or min(n_cases.values()) < _FEW_OF_A_CLASS:
        notes.append(Note.of("few_cases", n_cases=n))
    few = [label for label, count in n_cases.items() if count < _FEW]
    if few:
        notes.append(
            Note.of(
                "few_of_a_class",
                fewest=_FEW,
                classes=", ".join(few),
                them="it" if len(few) == 1 else "them",
            )
        )
    return tuple(notes)


def _always(cohort: Cohort, fit: Fit) -> tuple[Note, ...]:
    """Note in every answer what a user must know of what the model reads."""
    if not any(one.table.extractor.reads_motion for one in fit.tables):
        return (Note.of("volume_alone"),)
    topology = cohort.motions[0].modes.topology
    if topology is not None and topology.closed_axes and not cohort.walls:
        return (Note.of("wall_unknown"),)
    return ()
