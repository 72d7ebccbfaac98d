"""Changes a store from several threads until it is killed, saying what was acknowledged.

Run as a program with the folder and the number of the first sequence; begins when a line
arrives, so that it can be started ahead of time. One line for each change: "+" before its name
when it begins, "=" when it is acknowledged.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from service_table import visit
from store_samples import (
    KEY,
    put_classification,
    sample_classification,
    sample_model,
    sample_sequence,
    sample_signature,
)

from modalmotion.store import ResultStore

N_THREADS = 3


def say(sign: str, change: str, number: int) -> None:
    # One write of a short line to a pipe is never mixed with another.
    os.write(1, f"{sign} {change} {number}\n".encode())


def changes_of(store: ResultStore, number: int) -> dict[str, Callable[[], object]]:
    sequence = sample_sequence(number)
    signature = sample_signature(sequence)
    classification = sample_classification(sequence.id)
    changes: dict[str, Callable[[], object]] = {
        "put": lambda: store.put_sequence(sequence, subject="before"),
        "signature": lambda: store.put_signature(signature),
        "update": lambda: store.update_sequence(sequence.id, subject="after"),
        "classification": lambda: put_classification(store, classification, KEY),
        "model": lambda: store.put_model(sample_model(number, name=f"m{number}")),
        "visit": lambda: visit(store, number),
    }
    if number % 2:
        changes["delete"] = lambda: store.delete_sequence(sequence.id)
        changes["delete-model"] = lambda: store.delete_model(f"m{number}", 1)
    return changes


def work(store: ResultStore, number: int) -> None:
    while True:
        for name, change in changes_of(store, number).items():
            say("+", name, number)
            change()
            say("=", name, number)
        number += N_THREADS


def main() -> None:
    folder, first = Path(sys.argv[1]), int(sys.argv[2])
    sys.stdin.readline()
    store = ResultStore(folder).open()
    for thread in range(N_THREADS):
        threading.Thread(target=work, args=(store, first + thread)).start()


if __name__ == "__main__":
    main()
