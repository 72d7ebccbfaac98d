"""Results of sequences: taken from the store, or made and kept."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from modalmotion.classify import Classification, classify, load_model
from modalmotion.errors import NotFoundError
from modalmotion.signature import ModalSignature, SignatureParameters, modal_signature
from modalmotion.store import ResultStore


class Analysis:
    """Makes each result once, however many ask for it at the same time.

    Parameters
    ----------
    store : ResultStore
    """

    def __init__(self, store: ResultStore) -> None:
        self._store = store
        self._making: dict[tuple[str, ...], tuple[threading.Lock, int]] = {}
        self._guard = threading.Lock()

    def signature(
        self, sequence_id: str, parameters: SignatureParameters
    ) -> tuple[ModalSignature, Path]:
        """Give a signature and its file."""
        with self._one_at_a_time(sequence_id, parameters.key):
            try:
                signature = self._store.signature(sequence_id, parameters.key)
            except NotFoundError:
                signature = modal_signature(self._store.sequence(sequence_id), parameters)
                self._store.put_signature(signature)
        return signature, self._store.signature_path(sequence_id, parameters.key)

    def classification(
        self, sequence_id: str, model_name: str
    ) -> tuple[Classification, Path, bool]:
        """Give a classification, its file, and whether it is new."""
        model = load_model(model_name)
        with self._one_at_a_time(sequence_id, model.id):
            try:
                result = self._store.classification(sequence_id, model.id)
                is_new = False
            except NotFoundError:
                signature, _ = self.signature(sequence_id, model.signature_parameters)
                result = classify(signature, model)
                self._store.put_classification(result)
                is_new = True
        return result, self._store.classification_path(sequence_id, model.id), is_new

    @contextmanager
    def _one_at_a_time(self, *key: str) -> Iterator[None]:
        with self._guard:
            lock, users = self._making.get(key, (threading.Lock(), 0))
            self._making[key] = (lock, users + 1)
        try:
            with lock:
                yield
        finally:
            with self._guard:
                lock, users = self._making.pop(key)
                if users > 1:
                    self._making[key] = (lock, users - 1)
