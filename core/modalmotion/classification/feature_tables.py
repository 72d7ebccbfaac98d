"""Features of a cohort as a table: a line for each recording, a column for each feature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.classification import cohort, options
from modalmotion.classification.cases import AnyCase, LeftOut, TrainingCase
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Reporter
from modalmotion.representation import Floats, csv_text, shown
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    from modalmotion.classification.scikit_learn import SignatureFeatures

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
        NaN if a covariate is unknown.
    left_out : tuple of LeftOut
        Cases that could not be used, if the cohort goes on without them.
    """

    names: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    labels: tuple[str | None, ...]
    subjects: tuple[str | None, ...]
    columns: tuple[str, ...]
    values: Floats
    left_out: tuple[LeftOut, ...] = ()

    def beside(self, left_out: Sequence[LeftOut]) -> FeatureTable:
        """Return the table of a cohort of which these were left out before."""
        return replace(self, left_out=(*left_out, *self.left_out))

    def as_csv(self) -> str:
        """Write the table as CSV: `OF_CASES`, then the features to the last bit.

        What is unknown is empty.
        """
        lines: list[list[str]] = [[*OF_CASES, *self.columns]]
        for case, values in self._rows():
            numbers = ["" if value is None else repr(value) for value in values]
            lines.append([*(part or "" for part in case), *numbers])
        return csv_text(lines)

    def as_json(self) -> dict[str, Any]:
        """Return the table as JSON-able values; what is unknown is None."""
        return {
            "columns": list(self.columns),
            "cases": [
                {**dict(zip(OF_CASES, case, strict=True)), "values": values}
                for case, values in self._rows()
            ],
            "left_out": [case._asdict() for case in self.left_out],
        }

    @staticmethod
    def from_json(values: dict[str, Any]) -> FeatureTable:
        """Read the output of `as_json`."""
        cases, columns = values["cases"], tuple(values["columns"])
        numbers = np.array([case["values"] for case in cases], dtype=np.float64)
        names, ids, labels, subjects = (tuple(case[name] for case in cases) for name in OF_CASES)
        left_out = tuple(LeftOut(**case) for case in values["left_out"])
        shape = len(cases), len(columns)
        return FeatureTable(names, ids, labels, subjects, columns, numbers.reshape(shape), left_out)

    def _rows(self) -> Iterator[tuple[tuple[str | None, ...], list[float | None]]]:
        cases = zip(self.names, self.sequence_ids, self.labels, self.subjects, strict=True)
        values = np.where(np.isnan(self.values), None, self.values)  # type: ignore[call-overload]
        return zip(cases, values.tolist(), strict=True)


def feature_table(
    cases: Iterable[AnyCase | MeshSequence | ModalSignature],
    features: SignatureFeatures | None = None,
    *,
    on_error: options.OnError | str = options.OnError.RAISE,
    progress: Reporter | None = None,
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
        Called with the number of cases read, and of all.

    Raises
    ------
    ParameterError
        If there is no case, or an option of the features has no such value.
    UnlikeCasesError
        If the recordings do not compare.
    ModalMotionError
        If a case cannot be read or fitted; it is named.
    """
    from modalmotion.classification.scikit_learn import SignatureFeatures

    transformer = SignatureFeatures() if features is None else features
    sources = [
        TrainingCase(one, "") if isinstance(one, MeshSequence | ModalSignature) else one
        for one in cases
    ]
    read = cohort.alike(
        sources,
        transformer.signature_parameters,
        leaves_out=options.OnError(on_error) == options.OnError.LEAVE_OUT,
        progress=progress,
    )[0]
    values = transformer.fit_transform(read.cases)
    return FeatureTable(
        names=tuple(case.name for case in read.cases),
        sequence_ids=tuple(case.sequence_id for case in read.cases),
        labels=tuple(case.label or None for case in read.cases),
        subjects=tuple(case.subject for case in read.cases),
        columns=tuple(transformer.get_feature_names_out().tolist()),
        values=values,
        left_out=read.left_out,
    )
