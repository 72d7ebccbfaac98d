"""The labelled sequences of a training: looked up, checked, and noted for its job."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from modalmotion.errors import LimitError, NotFoundError, ParameterError
from modalmotion.mesh import Facts
from modalmotion.store import ResultStore
from modalmotion.store.disk import cannot_write
from modalmotion.store.folder import require_name
from modalmotion_service.schemas.cases import LabelledSequence
from modalmotion_service.workspace.spool import SpoolFile

# Of each class: one to learn from and one to test on.
LEAST_PER_CLASS: Final = 2

# Ids that an error names; a client that got everything wrong knows it from these.
_NAMED: Final = 20


@dataclass(frozen=True)
class Case:
    """One sequence of a training.

    Parameters
    ----------
    id : str
    label : str
        Empty where there is none.
    subject : str or None
    covariates : mapping of str to (float or str)
    """

    id: str
    label: str
    subject: str | None
    covariates: Mapping[str, float | str] = field(default_factory=dict)


def look_up(store: ResultStore, sequences: Sequence[LabelledSequence], most: int) -> list[Case]:
    """Find what is known of each sequence, and check that a model can be trained on them.

    Raises
    ------
    LimitError, NotFoundError
        As `find_cases` says.
    ParameterError
        As it says, too; or if some have no label, or there are too few of a class, or of
        classes; it names them.
    """
    cases = labelled_cases(store, sequences, most, "training_sequences")
    _require_classes(cases)
    return cases


def labelled_cases(
    store: ResultStore, sequences: Sequence[LabelledSequence], most: int, limit: str
) -> list[Case]:
    """Find what is known of each sequence as `find_cases` does, and check that all have a label.

    Raises
    ------
    LimitError, NotFoundError
        As `find_cases` says.
    ParameterError
        As it says, too; or if some have no label; it names them.
    """
    cases = find_cases(store, sequences, most, limit)
    unlabelled = [case.id for case in cases if not case.label]
    if unlabelled:
        raise ParameterError(
            f"{_count(unlabelled, 'sequence')} without a label: {_short(unlabelled)}.",
            remedy='State it here, as {"id": ..., "label": ...}, or with PATCH /v1/sequences/{id}.',
            details=_ids(unlabelled),
        )
    return cases


def find_cases(
    store: ResultStore, sequences: Sequence[LabelledSequence], most: int, limit: str
) -> list[Case]:
    """Find what is known of each sequence; the label is empty if there is none.

    Parameters
    ----------
    store : ResultStore
    sequences : sequence of LabelledSequence
    most : int
        Sequences that may be named.
    limit : str
        Name of that limit.

    Raises
    ------
    LimitError
        If there are more than `most`.
    NotFoundError
        If some are not kept; it names them.
    ParameterError
        If some are named twice, or a covariate cannot be one; it names them.
    """
    if len(sequences) > most:
        raise LimitError(
            f"{len(sequences)} sequences are named; the limit is {most}.",
            remedy="Name fewer, or have the limit raised.",
            limit=limit,
            details={"most": most},
        )
    repeated = [name for name, n in Counter(case.id for case in sequences).items() if n > 1]
    if repeated:
        raise ParameterError(
            f"{_count(repeated, 'sequence')} named more than once: {_short(repeated)}.",
            remedy="Name each sequence once: repeated, it would be on both sides of a split.",
            details=_ids(repeated),
        )
    cases, records = [], store.sequence_records(case.id for case in sequences)
    unknown = [case.id for case in sequences if case.id not in records]
    for case in sequences:
        if (record := records.get(case.id)) is None:
            continue
        label, subject = case.label or record.label or "", case.subject or record.subject
        stated = Facts(covariates=case.covariates or {}).over(record.facts)
        cases.append(Case(case.id, label, subject, dict(stated.covariates)))
        require_name("label", label or None)
        require_name("subject", subject)
    if unknown:
        raise NotFoundError(
            f"{_count(unknown, 'sequence')} not kept here: {_short(unknown)}.",
            remedy="Send them first, or leave them out.",
            details=_ids(unknown),
        )
    return cases


def _require_classes(cases: list[Case]) -> None:
    per_class = Counter(case.label for case in cases)
    if len(per_class) < 2:
        only = f"only {next(iter(per_class))!r}" if per_class else "no sequence"
        raise ParameterError(
            f"A model tells at least two classes apart; there is {only}.",
            remedy="Name sequences of two or more classes.",
            details={"classes": dict(per_class)},
        )
    few = sorted(label for label, n in per_class.items() if n < LEAST_PER_CLASS)
    if few:
        ids = [case.id for case in cases if case.label in few]
        raise ParameterError(
            f"Of {_listed(few)} there {'is' if len(ids) == 1 else 'are'} fewer than "
            f"{LEAST_PER_CLASS} sequences: {_short(ids)}.",
            remedy=f"Name {LEAST_PER_CLASS} or more of each class, ten or more for class sets "
            "that rule anything out; or leave the class out.",
            details={"classes": dict(per_class), "least": LEAST_PER_CLASS, **_ids(ids)},
        )


def write_cases(file: SpoolFile, cases: list[Case]) -> None:
    """Note the cases of a training durably, for its job to read.

    Raises
    ------
    StoreError
        If they cannot be written.
    """
    try:
        file.path.write_text(json.dumps([asdict(case) for case in cases]))
    except OSError as error:
        raise cannot_write(file.path, error) from error
    file.make_durable()


def read_cases(file: Path) -> list[Case]:
    """Read what `write_cases` wrote."""
    return [Case(**value) for value in json.loads(file.read_text())]


def _count(ids: list[str], noun: str) -> str:
    return f"1 {noun} is" if len(ids) == 1 else f"{len(ids)} {noun}s are"


def _short(ids: list[str]) -> str:
    more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
    return ", ".join(name[:12] for name in ids[:3]) + more


def _ids(ids: list[str]) -> dict[str, object]:
    return {"sequence_ids": ids[:_NAMED], "n_sequences": len(ids)}


def _listed(labels: list[str]) -> str:
    more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
    return ", ".join(repr(label) for label in labels[:3]) + more
