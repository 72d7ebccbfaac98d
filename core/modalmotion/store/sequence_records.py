"""The part of the store that keeps records of sequences: what is stated about them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from modalmotion.errors import ParameterError
from modalmotion.facts import NO_FACTS, Facts
from modalmotion.store.folder import is_id
from modalmotion.store.index.index import SequencePage
from modalmotion.store.opening import Opening, unknown_sequence
from modalmotion.store.record import UNSET, SequenceRecord, Unset, record_to_json, require_name


class SequenceRecords(Opening):
    """Records of the sequences in a folder."""

    def count(self) -> dict[str, int]:
        """Numbers of sequences and of results, by kind."""
        return self._open_index().count()

    def has_sequence(self, sequence_id: str) -> bool:
        """Whether a sequence is known."""
        return is_id(sequence_id) and self._open_index().find(sequence_id) is not None

    def sequence_record(self, sequence_id: str) -> SequenceRecord:
        """Look up the record of a sequence.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        index = self._open_index()
        record = index.find(sequence_id) if is_id(sequence_id) else None
        if record is None:
            raise unknown_sequence(sequence_id)
        return record

    def sequence_records(self, sequence_ids: Iterable[str]) -> dict[str, SequenceRecord]:
        """Look up the records of many sequences at once, by their ids; of those that there are."""
        return self._open_index().find_all(filter(is_id, sequence_ids))

    def list_sequences(
        self,
        *,
        subject: str | None = None,
        label: str | None = None,
        limit: int = 100,
        cursor: str | None = None,
    ) -> SequencePage:
        """Sequences from the newest to the oldest.

        A sequence that is present from the first page to the last is listed once, even if
        others are put or deleted meanwhile.

        Parameters
        ----------
        subject, label : str, optional
            Only those with exactly this subject, this label.
        limit : int
            Of one page, 1 to 1000.
        cursor : str, optional
            Of the page before.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is not one of a list.
        """
        return self._open_index().page(subject, label, limit, cursor)

    def update_sequence(
        self,
        sequence_id: str,
        *,
        name: str | Unset | None = UNSET,
        subject: str | Unset | None = UNSET,
        label: str | Unset | None = UNSET,
        change: Callable[[Facts], Facts] = lambda facts: facts,
    ) -> SequenceRecord:
        """Change the name, the subject, the label, the facts or all; omitted values stay.

        Results with other landmarks stay under their own keys; later results have new ones.

        Parameters
        ----------
        sequence_id : str
        name, subject, label : str or None, optional
        change : callable
            New facts from the stored ones; no other change comes between.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        ParameterError
            If name, subject or label cannot be kept, or facts contradict the vertices or times.
        StoreError
            If it cannot be written; the store is as it was.
        """
        texts = {"name": name, "subject": subject, "label": label}
        stated: dict[str, Any] = {
            what: text for what, text in texts.items() if not isinstance(text, Unset)
        }
        for what, text in stated.items():
            require_name(what, text)
        index = self._open_index()
        self.sequence_record(sequence_id)
        with self._changing(sequence_id):
            known = self.sequence_record(sequence_id)
            facts = change(known.facts)
            if facts != known.facts:
                facts.require_fit(known.n_vertices, known.span)
            record = replace(known, facts=facts, **stated)
            if record != known:
                file = (self._folder.record(sequence_id), record_to_json(record))
                self._write([file], lambda: index.put(record, erases=True))
        return record

    def complete_sequence(
        self,
        sequence_id: str,
        *,
        subject: str | None = None,
        label: str | None = None,
        facts: Facts = NO_FACTS,
        offered: Facts = NO_FACTS,
    ) -> tuple[SequenceRecord, tuple[str, ...]]:
        """Fill in what is not known of a sequence yet; what is known must agree.

        Parameters
        ----------
        sequence_id : str
        subject, label : str, optional
        facts : Facts
            Landmarks and covariates each by its name.
        offered : Facts
            Passed over where they differ from what is known.

        Returns
        -------
        record : SequenceRecord
        names : tuple of str
            Of what was filled in: `subject`, `label`, and facts.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        ParameterError
            If a value is known to be another, or cannot be kept; nothing is changed. The
            details name those that differ.
        StoreError
            If it cannot be written; the store is as it was.
        """
        require_name("subject", subject)
        require_name("label", label)
        index = self._open_index()
        with self._changing(sequence_id):
            known = self.sequence_record(sequence_id)
            stated = {"subject": subject, "label": label}
            new = {name: text for name, text in stated.items() if text is not None}
            differ = [
                name for name, text in new.items() if getattr(known, name) not in (None, text)
            ]
            completed = known.facts.over(facts)
            differ += completed.changed(facts.over(known.facts))
            with contextlib.suppress(ParameterError):
                completed = completed.over(offered)
            if differ:
                raise ParameterError(
                    f"The sequence is known with another {' and another '.join(differ)}; nothing "
                    "was changed.",
                    remedy="Change it with `update_sequence`.",
                    details={"differ": differ},
                )
            if completed != known.facts:
                completed.require_fit(known.n_vertices, known.span)
            record = replace(
                known,
                facts=completed,
                subject=known.subject if subject is None else subject,
                label=known.label if label is None else label,
            )
            if record != known:
                file = (self._folder.record(sequence_id), record_to_json(record))
                self._write([file], lambda: index.put(record))
        filled = [name for name in new if getattr(known, name) is None]
        return record, (*filled, *completed.changed(known.facts))
