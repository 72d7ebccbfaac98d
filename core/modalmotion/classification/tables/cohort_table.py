"""Features of a cohort as a table: a line for each recording, a column for each feature."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.options import OnError
from modalmotion.classification.training.case_reading import basis_of
from modalmotion.classification.training.cases import AnyCase, TrainingCase, named
from modalmotion.classification.training.left_out import UNUSABLE, LeftOut
from modalmotion.errors import ModalMotionError, ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import csv_text, shown
from modalmotion.signature.making import ModalSignature, SignatureParameters

if TYPE_CHECKING:
    from modalmotion.classification.tables.signature_features import SignatureFeatures

OF_CASES: Final = ("case", "sequence_id", "label", "subject")
"""Columns before the features."""


@shown("columns", "values", "left_out")
@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Features of a cohort.

    Parameters
    ----------
    names, sequence_ids : tuple of str
        Of each case; the name may be empty.
    labels, subjects : tuple of (str or None)
    columns : tuple of str
    values : (cases, features) float64
        NaN where a covariate is unknown.
    left_out : tuple of LeftOut
        Cases that could not be used, if the cohort goes on without them.
    """

    names: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    labels: tuple[str | None, ...]
    subjects: tuple[str | None, ...]
    columns: tuple[str, ...]
    values: NDArray[np.float64]
    left_out: tuple[LeftOut, ...] = ()

    def beside(self, left_out: Sequence[LeftOut]) -> FeatureTable:
        """Return the table of a cohort of which these were left out before."""
        return replace(self, left_out=(*left_out, *self.left_out))

    def as_csv(self) -> str:
        """Write the table as CSV: `OF_CASES`, then the features to the last bit.

        What is unknown is empty.
        """
        lines: list[list[str]] = [[*OF_CASES, *self.columns]]
        cases = zip(self.names, self.sequence_ids, self.labels, self.subjects, strict=True)
        for case, values in zip(cases, self.values.tolist(), strict=True):
            numbers = ["" if math.isnan(value) else repr(value) for value in values]
            lines.append([*(part or "" for part in case), *numbers])
        return csv_text(lines)

    def as_json(self) -> dict[str, Any]:
        """Return the table as JSON-able values; what is unknown is None."""
        cases = zip(self.names, self.sequence_ids, self.labels, self.subjects, strict=True)
        return {
            "columns": list(self.columns),
            "cases": [
                {
                    **dict(zip(OF_CASES, case, strict=True)),
                    "values": [None if math.isnan(value) else value for value in values],
                }
                for case, values in zip(cases, self.values.tolist(), strict=True)
            ],
            "left_out": [case._asdict() for case in self.left_out],
        }

    @staticmethod
    def from_json(values: dict[str, Any]) -> FeatureTable:
        """Read the output of `as_json`."""
        cases = values["cases"]
        names, ids, labels, subjects = (tuple(case[n] for case in cases) for n in OF_CASES)
        table = [[math.nan if v is None else v for v in case["values"]] for case in cases]
        columns = tuple(values["columns"])
        return FeatureTable(
            names=names,
            sequence_ids=ids,
            labels=labels,
            subjects=subjects,
            columns=columns,
            values=np.array(table, dtype=np.float64).reshape(len(cases), len(columns)),
            left_out=tuple(LeftOut(**case) for case in values["left_out"]),
        )


def feature_table(
    cases: Iterable[AnyCase | MeshSequence | ModalSignature],
    features: SignatureFeatures | None = None,
    *,
    on_error: OnError | str = OnError.RAISE,
    progress: Callable[[int], None] | None = None,
) -> FeatureTable:
    """Read the features of a cohort.

    Parameters
    ----------
    cases : iterable of TrainingCase, CaseSource, MeshSequence or ModalSignature
        Read one by one; sequences are fitted.
    features : SignatureFeatures, optional
        Fitted to these recordings here; with all options at their defaults if left out.
    on_error : OnError
        "leave out" goes on without the cases that cannot be read or fitted or do not compare.
    progress : callable, optional
        Called with the number of cases that have been read.

    Raises
    ------
    ParameterError
        If there is no case, or an option of the features has no such value.
    UnlikeCasesError
        If the recordings do not compare.
    ModalMotionError
        If a case cannot be read or fitted; it is named.
    """
    from modalmotion.classification.tables.signature_features import SignatureFeatures

    transformer = SignatureFeatures() if features is None else features
    leaves_out = OnError(on_error) == OnError.LEAVE_OUT
    parameters = transformer.signature_parameters
    own = _fitted(cases, parameters, leaves_out=leaves_out, progress=progress)
    try:
        return _table(own, transformer)
    except UnlikeCasesError as error:
        unlike = _by_name(error, own)
    cohorts = [own]
    if parameters.topology is None:
        springs = replace(parameters, closed_form=False)
        again = _fitted(own.cases, springs, leaves_out=True)
        if leaves_out or not again.left_out:
            cohorts.append(again._replace(left_out=[*own.left_out, *again.left_out]))
    # Those of one basis; then, where surfaces do not mix, of one topology.
    for quality in (None, basis_of, attrgetter("surface")) if leaves_out else (None,):
        if quality is not None:
            cohorts = [_commonest(cohort, quality) for cohort in cohorts]
        for cohort in sorted(cohorts, key=lambda one: -len(one.cases)):
            with contextlib.suppress(UnlikeCasesError):
                return _table(cohort, transformer)
    raise unlike


class _Cohort(NamedTuple):
    cases: list[TrainingCase]
    signatures: list[ModalSignature]
    left_out: list[LeftOut]


def _fitted(
    sources: Iterable[AnyCase | MeshSequence | ModalSignature],
    parameters: SignatureParameters,
    *,
    leaves_out: bool,
    progress: Callable[[int], None] | None = None,
) -> _Cohort:
    cohort = _Cohort([], [], [])
    for number, source in enumerate(sources):
        called = _called(source, number)
        try:
            case = _case(source)
            signature = case.fitted(parameters).signature
            if signature.n_frames < 2:
                raise ParameterError(
                    f"{called} has one frame, which shows no motion.", remedy="Leave it out."
                )
        except UNUSABLE as error:
            if not leaves_out:
                raise
            cohort.left_out.append(LeftOut.of(error, called))
        else:
            cohort.cases.append(case)
            cohort.signatures.append(signature)
        if progress is not None:
            progress(number + 1)
    return cohort


def _called(source: object, number: int) -> str:
    return str(getattr(source, "name", "") or f"case {number}")


def _case(source: AnyCase | MeshSequence | ModalSignature) -> TrainingCase:
    if isinstance(source, MeshSequence | ModalSignature):
        return TrainingCase(source, "")
    return source if isinstance(source, TrainingCase) else source.read()


def _commonest(cohort: _Cohort, quality: Callable[[ModalSignature], Any]) -> _Cohort:
    """Keep the cases that share the commonest value of a quality; leave the others out."""
    values = [quality(signature) for signature in cohort.signatures]
    most = Counter(values).most_common(1)[0][0] if values else None
    kept = _Cohort([], [], list(cohort.left_out))
    for k, (case, signature) in enumerate(zip(cohort.cases, cohort.signatures, strict=True)):
        if values[k] == most:
            kept.cases.append(case)
            kept.signatures.append(signature)
        else:
            why = f"Its {len(signature.modes)} modes of a {signature.surface} do not compare with "
            kept.left_out.append(LeftOut(_called(case, k), f"{why}those of most."))
    return kept


def _by_name(error: UnlikeCasesError, cohort: _Cohort) -> ModalMotionError:
    number = error.details.get("case")
    return named(error, cohort.cases[number].name if isinstance(number, int) else "")


def _table(cohort: _Cohort, transformer: SignatureFeatures) -> FeatureTable:
    values = transformer.fit_transform(cohort.signatures)
    cases = cohort.cases
    return FeatureTable(
        names=tuple(case.name for case in cases),
        sequence_ids=tuple(case.sequence_id for case in cases),
        labels=tuple(case.label or None for case in cases),
        subjects=tuple(case.subject for case in cases),
        columns=tuple(transformer.get_feature_names_out().tolist()),
        values=values,
        left_out=tuple(cohort.left_out),
    )
